"""The thread that takes the steps, and its clock."""
