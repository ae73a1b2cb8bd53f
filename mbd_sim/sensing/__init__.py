"""Errors of measurements: noise that is a function of the number of the sample, and what is done to each value."""
