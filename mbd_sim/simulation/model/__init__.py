"""The compiled model of a mechanism, and how it is built."""
