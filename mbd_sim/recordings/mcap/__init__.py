"""MCAP and rosbag2 files: written, read, checked and repaired."""
