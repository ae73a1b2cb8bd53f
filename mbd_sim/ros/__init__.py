"""The nodes for ROS 2."""
