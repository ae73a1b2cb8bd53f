"""Example: a controller raises a hydraulic scissor lift to one level after the other, and holds it there."""
