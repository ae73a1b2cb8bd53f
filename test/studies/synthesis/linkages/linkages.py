"""Closed forms of four-bars and slider-cranks, independent of the dyads."""

import numpy as np

from mbd_sim.studies.synthesis.linkages import PlanePose


def four_bar_poses(theta, a=0.4, b=1.3, c=1.1, d=1.4, mode=1.0, offset=0.3 - 0.2j):
    """Poses of a frame on the coupler: law of cosines, pivots at 0 and d; and both pins in the first pose."""
    pin = a * np.exp(1j * np.asarray(theta))
    across = d - pin
    reach = np.abs(across)
    angle = np.angle(across) + mode * np.arccos((b * b + reach**2 - c * c) / (2.0 * b * reach))
    origin = pin + offset * np.exp(1j * angle)
    poses = [PlanePose(p.real, p.imag, float(phi)) for p, phi in zip(origin.tolist(), angle, strict=True)]
    return poses, complex(pin[0]), complex(pin[0] + b * np.exp(1j * angle[0]))


def slider_crank_poses(theta, a=0.4, b=1.3, e=0.1):
    """Poses of a coupler whose end runs along y = e; and its pins in the first pose."""
    pin = a * np.exp(1j * np.asarray(theta))
    angle = np.arcsin((e - pin.imag) / b)
    poses = [PlanePose(p.real, p.imag, float(phi)) for p, phi in zip(pin.tolist(), angle, strict=True)]
    return poses, complex(pin[0]), complex(pin[0] + b * np.exp(1j * angle[0]))


def random_poses(random, count):
    """Poses anywhere."""
    return [PlanePose(*random.uniform(-1.0, 1.0, 2).tolist(), float(random.uniform(-3.0, 3.0))) for _ in range(count)]
