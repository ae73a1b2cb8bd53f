"""Example: efforts from the keyboard or a joystick."""
