"""The distance of two convex bodies as a convex program in the coordinates of a point of each (SLSQP)."""

import numpy as np
from scipy.optimize import minimize


def inequalities(kind, sizes, point):
    """Numbers that are not negative while a point (3,), in the frame of the body, is in it."""
    x, y, z = point
    match kind:
        case "ellipsoid":
            return [1.0 - np.sum((point / sizes) ** 2)]
        case "cylinder" | "disc":
            radius, length = (*sizes, 0.0)[:2]
            return [1.0 - (x * x + y * y) / radius**2, length / 2.0 - z, z + length / 2.0]
        case "cone":
            radius, length = sizes
            wide = radius * (0.5 - z / length)
            return [wide - np.hypot(x, y), z + length / 2.0, length / 2.0 - z]
        case "block":
            return [*(np.array(sizes) / 2.0 - point), *(point + np.array(sizes) / 2.0)]
        case "rod":  # of a length, rounded by a radius
            return [sizes[0] / 2.0 - z, z + sizes[0] / 2.0, 1e-12 - x * x - y * y]
    raise ValueError(kind)


def distance(one, other):
    """Of two bodies (kind, sizes, pose) that are apart; the radius of a rod is subtracted by the caller."""

    def points(v):
        return v[:3], v[3:]

    def inside(v):
        return np.array(
            [
                value
                for (kind, sizes, pose), point in zip((one, other), points(v), strict=True)
                for value in inequalities(kind, np.array(sizes), pose.rotation.T @ (point - pose.position))
            ]
        )

    def square(v):
        line = v[:3] - v[3:]
        return line @ line, np.concatenate([2.0 * line, -2.0 * line])

    best = np.inf
    start = np.concatenate([one[2].position, other[2].position])
    for seed in range(3):
        begin = start + 0.05 * seed * np.random.default_rng(seed).normal(size=6)
        options = {"ftol": 1e-15, "maxiter": 400}
        found = minimize(
            square, begin, jac=True, constraints={"type": "ineq", "fun": inside}, method="SLSQP", options=options
        )
        if np.min(inside(found.x)) > -1e-7:
            best = min(best, float(np.sqrt(found.fun)))
    return best
