"""The scale of drawn forces, and where the arrows of contacts start."""

from __future__ import annotations

import numpy as np

from mbd_sim.mechanism.constraints import Cable, Distance
from mbd_sim.mechanism.records import Mechanism
from mbd_sim.mechanism.source import Location

LONG, LONGEST = 0.25, 0.6  # full and largest length of an arrow, relative to the mechanism's size


def weight(mechanism: Mechanism, size: float) -> float:
    """The force in N that an arrow of full length stands for by default: the weight of all parts.

    Without gravity, the force that accelerates the mechanism by its own `size` in m each second squared.
    """
    return mechanism.mass * (float(np.linalg.norm(mechanism.gravity)) or size) or 1.0


def pulls(mechanism: Mechanism, owner: Location) -> bool:
    """Whether a contact is a rope, whose arrow starts at its end. All others push: their arrows end at the contact.

    Inside the body that it pushes, an arrow would be hidden.
    """
    ropes = [one for one in mechanism.constraints if isinstance(one, Distance | Cable) and one.bound == "at_most"]
    return any(owner == ("constraints", rope.name) for rope in ropes)
