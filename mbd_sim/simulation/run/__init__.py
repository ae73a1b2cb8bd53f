"""One simulation: its state, inputs, readings, sensors and events."""
