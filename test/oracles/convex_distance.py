"""The distance of two convex bodies as a convex program in the coordinates of a point of each (SLSQP)."""

import numpy as np
from scipy.optimize import minimize

COORDINATES = {"disc": [0, 1], "rod": [2]}  # of a point in the frame of the body; of all others, all three


def inequalities(kind, sizes, point):
    """Numbers that are not negative while a point (3,), in the frame of the body, is in it, and their gradients."""
    x, y, z = point
    match kind:
        case "ellipsoid":
            return [1.0 - np.sum((point / sizes) ** 2)], [-2.0 * point / sizes**2]
        case "cylinder" | "disc":
            radius, length = (*sizes, 0.0)[:2]
            ends, along = [length / 2.0 - z, z + length / 2.0], [(0.0, 0.0, -1.0), (0.0, 0.0, 1.0)]
            across = -2.0 * x / radius**2, -2.0 * y / radius**2, 0.0
            round_it = 1.0 - (x * x + y * y) / radius**2
            return ([round_it], [across]) if kind == "disc" else ([round_it, *ends], [across, *along])
        case "cone":
            radius, length = sizes
            from_axis = np.hypot(x, y)
            outwards = (x / from_axis, y / from_axis) if from_axis else (0.0, 0.0)
            return (
                [radius * (0.5 - z / length) - from_axis, z + length / 2.0, length / 2.0 - z],
                [(-outwards[0], -outwards[1], -radius / length), (0.0, 0.0, 1.0), (0.0, 0.0, -1.0)],
            )
        case "block":
            return [*(sizes / 2.0 - point), *(point + sizes / 2.0)], [*-np.eye(3), *np.eye(3)]
        case "rod":  # of a length, rounded by a radius
            return [sizes[0] / 2.0 - z, z + sizes[0] / 2.0], [(0.0, 0.0, -1.0), (0.0, 0.0, 1.0)]
    raise ValueError(kind)


def distance(one, other):
    """Of two bodies (kind, sizes, pose) that are apart; the radius of a rod is subtracted by the caller."""
    bodies = [(kind, np.array(sizes), pose, COORDINATES.get(kind, [0, 1, 2])) for kind, sizes, pose in (one, other)]
    (first, second) = (pose.rotation[:, used] for _, _, pose, used in bodies)
    line, apart = np.hstack([first, -second]), bodies[0][2].position - bodies[1][2].position
    count = len(bodies[0][3])

    def conditions(v):
        values, gradients = [], []
        for (kind, sizes, _, used), part in zip(bodies, (slice(None, count), slice(count, None)), strict=True):
            point = np.zeros(3)
            point[used] = v[part]
            value, slopes = inequalities(kind, sizes, point)
            rows = np.zeros((len(value), v.size))
            rows[:, part] = np.array(slopes)[:, used]
            values += value
            gradients.append(rows)
        return np.array(values), np.vstack(gradients)

    def square(v):
        between = apart + line @ v
        return between @ between, 2.0 * between @ line

    best = np.inf
    for seed in range(3):
        begin = 0.05 * seed * np.random.default_rng(seed).normal(size=line.shape[1])
        found = minimize(
            square,
            begin,
            jac=True,
            constraints={"type": "ineq", "fun": lambda v: conditions(v)[0], "jac": lambda v: conditions(v)[1]},
            method="SLSQP",
            options={"ftol": 1e-15, "maxiter": 400},
        )
        if np.min(conditions(found.x)[0]) > -1e-7:
            best = min(best, float(np.sqrt(found.fun)))
    return best
