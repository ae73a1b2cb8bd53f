"""Pictures and plots of mechanisms and runs in notebooks."""
