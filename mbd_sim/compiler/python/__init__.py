"""Machine code as Python callables."""
