"""The mechanism file as data: one class for each thing that a user may write."""
