"""The records of parts, joints, forces, constraints, contacts, actuators and sensors."""
