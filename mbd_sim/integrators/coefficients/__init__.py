"""The coefficients of methods, as they were published."""
