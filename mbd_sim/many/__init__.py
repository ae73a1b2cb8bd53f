"""Many runs: learning environments and sweeps."""
