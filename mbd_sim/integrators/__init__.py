"""Integration methods as data: coefficients, orders and error estimates."""
