"""The services and the action of `simulation_interfaces`, a standard that simulators share."""
