"""Where coordinates, inputs and states of actuators are in vectors."""
