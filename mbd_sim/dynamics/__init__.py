"""What the textbook derives: kinematics, forces, and the equations of motion."""
