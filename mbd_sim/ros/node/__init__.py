"""The node of a simulation: parameters, services, subscriptions."""
