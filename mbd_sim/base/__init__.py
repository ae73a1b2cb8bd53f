"""What every other folder may use: errors, poses and rotations, the cache on disk."""
