"""A mechanism as a Functional Mock-up Unit (FMU) of the Functional Mock-up Interface 3.0."""
