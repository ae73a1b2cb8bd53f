"""Motors, servos and cylinders as equations."""
