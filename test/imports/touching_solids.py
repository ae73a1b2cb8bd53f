"""Pairs of solids of OpenCASCADE that touch, and the joint that they leave."""

from test.generators import step_files as cad

Z = (0, 0, 1)
PLATE = cad.cut(cad.box((-20, -20, 0), (40, 40, 10)), cad.cylinder((0, 0, -5), Z, 5.0, 20.0))
PIN = cad.cylinder((0, 0, -10), Z, 5.0, 30.0)
RIVET = cad.fused(PIN, cad.cylinder((0, 0, -4), Z, 8.0, 4.0), cad.cylinder((0, 0, 10), Z, 8.0, 4.0))
BOLT = cad.fused(PIN, cad.cylinder((0, 0, 10), Z, 8.0, 4.0))
FLAT = (cad.box((2, -9, -15), (9, 18, 40)),)  # what makes a pin a D
SOCKET = cad.cut(cad.box((-20, -20, -20), (40, 40, 20)), cad.sphere((0, 0, 0), 12.0))
BALL = cad.sphere((0, 0, 0), 12.0)
GROOVE = cad.cut(cad.box((-20, -20, -10), (40, 40, 10)), cad.box((-30, -5, -5), (60, 10, 6)))
STONE = cad.box((-8, -5, -5), (16, 10, 12))
TWO_HOLES = cad.cut(cad.box((-20, -20, 0), (40, 40, 10)), *(cad.cylinder((x, 0, -5), Z, 4.0, 20.0) for x in (-9, 9)))
TWO_RODS = cad.fused(cad.box((-20, -20, 14), (40, 40, 6)), *(cad.cylinder((x, 0, -5), Z, 4.0, 22.0) for x in (-9, 9)))
FITTED = cad.fused(cad.box((-20, -20, 10), (40, 40, 6)), *(cad.cylinder((x, 0, 2), Z, 4.0, 10.0) for x in (-9, 9)))
LINK = cad.cut(cad.box((-8, -8, 0), (60, 16, 5)), cad.cylinder((0, 0, -5), Z, 5.0, 20.0))
UPPER = cad.cut(cad.box((-8, -60, 5), (16, 68, 5)), cad.cylinder((0, 0, -5), Z, 5.0, 20.0))
LYING = cad.box((-5, -5, 0), (10, 10, 10))
TABLE = cad.box((-20, -20, -5), (40, 40, 5))
WIDE = cad.cut(cad.box((-20, -20, 0), (40, 40, 10)), cad.cylinder((0, 0, -5), Z, 6.0, 20.0))
CORNER = cad.cut(cad.box((0, 0, 0), (30, 30, 10)), cad.box((-1, -1, 5), (21, 21, 6)))

CASES = {
    "hinge: shoulders on both sides": (PLATE, RIVET, "revolute", Z),
    "hinge: holes of two links without a pin": (LINK, UPPER, "revolute", Z),
    "cylindrical: a plain pin": (PLATE, PIN, "cylindrical", Z),
    "cylindrical: a shoulder on one side": (PLATE, BOLT, "cylindrical", Z),
    "slider: a D-shaped pin": (cad.fused(PLATE, cad.cut(cad.cylinder((0, 0, 0), Z, 5.0, 10.0), cad.box((-9, -9, -5), (11, 18, 20)))), cad.cut(PIN, *FLAT), "prismatic", Z),
    "slider: two rods in two holes": (TWO_HOLES, TWO_RODS, "prismatic", Z),
    "slider: a stone in a groove": (GROOVE, STONE, "prismatic", (1, 0, 0)),
    "ball in a socket": (SOCKET, BALL, "spherical", None),
    "planar: a block on a table": (TABLE, LYING, "planar", Z),
    "weld: in a corner of three planes": (CORNER, cad.box((0, 0, 5), (20, 20, 5)), "fixed", None),
}  # fmt: skip
