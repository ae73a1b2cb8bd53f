"""What a mechanism becomes in an MJCF: bodies and joints, equalities, tendons and actuators, contacts."""
