"""The services of `simulation_interfaces`, a standard that simulators share."""
