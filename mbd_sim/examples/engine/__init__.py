"""Example: a small engine on a test bench is started, and braked so that it runs at one speed after the other."""
