"""All contacts of a step of time stepping together: their forces, impulses and modes, in the subset of Python."""
