"""MJCF, the format of MuJoCo, read as a mechanism, and a mechanism written as MJCF."""
