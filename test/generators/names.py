"""Random names as CAD programs, URDF, SDF and MJCF write them, and mechanisms with such names."""

from mbd_sim.mechanism.values.names import in_expression, is_name, reference

LETTERS = "ab1_-/.: '\"\\()[],=<>&*+#@%$!?~^;|`éß日🤖"


def random_name(rng, used):
    """A name that is not used yet."""
    while True:
        name = "".join(rng.choice(LETTERS) for _ in range(rng.randint(1, 6)))
        if is_name(name) and not name.startswith("/") and name not in used:
            used.add(name)
            return name


def plain_names(count):
    return [f"name{number}" for number in range(count)]


def random_names(rng, count):
    used = {"ground"}
    return [random_name(rng, used) for _ in range(count)]


COUNT = 15


def named_mechanism(names):
    """The data of a mechanism file with these names: three links, expressions, points, sensors, an actuator."""
    own, p, q, r, hinge, slide, table, tip, eye, imu, tacho, motor, effort, spring, encoder = names
    law = f"-2*{in_expression(hinge)}.velocity + {in_expression(slide)}*0.5 - {in_expression(table + '.x')}.position"
    rod = {"type": "rod", "to": [1, 0, 0], "radius": 0.02}
    return {
        "mechanism": own,
        "parts": {
            p: {"mass": 1, "inertia": [0.1, 0.1, 0.1], "points": {tip: [1, 0, 0]}, "shape": rod},
            q: {"mass": 1, "inertia": [0.1, 0.1, 0.1], "points": {eye: [0.5, 0, 0]}},
            r: {"mass": 1, "inertia": [0.1, 0.2, 0.1], "center": [0.1, 0.2, 0]},
        },
        "joints": {
            hinge: {"type": "revolute", "axis": [0, 1, 0], "between": ["ground", reference(p)], "damping": 0.1},
            slide: {"type": "prismatic", "axis": [0, 1, 0], "between": [reference(p, tip), reference(q)]},
            table: {"type": "planar", "axis": [0, 1, 0], "between": [reference(q, eye), reference(r)]},
        },
        "forces": {
            effort: {"type": "effort", "coordinate": hinge, "effort": law},
            spring: {"type": "spring", "between": ["ground", reference(q, eye)], "stiffness": 3, "length": 0.3},
        },
        "actuators": {motor: {"type": "effort", "joint": slide}},
        "sensors": {
            imu: {"type": "imu", "at": reference(q, eye), "rate": 100},
            tacho: {"type": "tachometer", "joint": hinge, "rate": 100},
            encoder: {"type": "encoder", "joint": f"{table}.x", "resolution": 0.001, "rate": 100},
        },
    }
