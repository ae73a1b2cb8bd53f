"""The memory of a kernel, and the sensors that sample it."""
