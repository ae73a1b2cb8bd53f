"""Coefficients of the Rosenbrock-W method ROS34PW2 (Rang & Angermann, BIT Numerical Mathematics 45, 2005).

It has four stages and order 3 for any approximation of the Jacobian; with the exact one it is L-stable and stiffly
accurate. These are the coefficients α, Γ, b and those of the embedded method of order 2, as published.
"""

GAMMA = 4.3586652150845900e-01
ALPHA: tuple[tuple[float, ...], ...] = (
    (),
    (8.7173304301691801e-01,),
    (8.4457060015369423e-01, -1.1299064236484185e-01),
    (0.0, 0.0, 1.0),
)
OFF_DIAGONAL: tuple[tuple[float, ...], ...] = (
    (),
    (-8.7173304301691801e-01,),
    (-9.0338057013044082e-01, 5.4180672388095326e-02),
    (2.4212380706095346e-01, -1.2232505839045147e00, 5.4526025533510214e-01),
)
B = (2.4212380706095346e-01, -1.2232505839045147e00, 1.5452602553351020e00, 4.3586652150845900e-01)
EMBEDDED = (3.7810903145819369e-01, -9.6042292212423178e-02, 5.0e-01, 2.1793326075422950e-01)
