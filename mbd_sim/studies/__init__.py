"""Studies of mechanisms: reports, formulas, loci, kinematics, optimization, synthesis."""
