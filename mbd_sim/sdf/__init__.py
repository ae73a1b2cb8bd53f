"""SDF, the format of Gazebo, read as a mechanism, and a mechanism written as SDF."""
