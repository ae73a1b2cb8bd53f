"""What a notebook shows of a mechanism, a simulation and a run. It needs no notebook to be imported."""
