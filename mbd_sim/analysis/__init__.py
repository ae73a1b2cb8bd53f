"""What is computed from the equations of a mechanism on request, without a simulation."""
