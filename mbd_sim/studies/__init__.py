"""Studies of mechanisms, which may use simulations: reports, formulas, loci, kinematics, optimization, synthesis."""
