"""Example: cascade control turns an arm on a DC motor from target to target."""
