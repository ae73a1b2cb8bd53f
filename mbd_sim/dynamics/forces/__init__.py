"""Forces of springs, dampers, bushings, joints and applied loads."""
