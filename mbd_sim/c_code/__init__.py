"""The equations of motion and the steps of a mechanism as C code without dependencies."""
