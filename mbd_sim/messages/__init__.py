"""The topics of a run and their messages, serialized without ROS: the node publishes them, recordings contain them."""
