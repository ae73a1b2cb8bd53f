"""The scale of drawn forces."""

from __future__ import annotations

import numpy as np

from mbd_sim.mechanism.records import Mechanism

LONG, LONGEST = 0.25, 0.6  # full and largest length of an arrow, relative to the mechanism's size


def weight(mechanism: Mechanism, size: float) -> float:
    """The force in N that an arrow of full length stands for by default: the weight of all parts.

    Without gravity, the force that accelerates the mechanism by its own `size` in m each second squared.
    """
    return mechanism.mass * (float(np.linalg.norm(mechanism.gravity)) or size) or 1.0
