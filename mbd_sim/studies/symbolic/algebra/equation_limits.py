"""How long equations may be that are written out."""

from __future__ import annotations

from mbd_sim.base.errors import MbdSimError
from mbd_sim.mechanism.mechanism import Mechanism

MAX_INSTRUCTIONS = 20_000
MAX_TERMS = 200  # of one entry before simplification
MAX_OPERATIONS = 400  # of one entry after simplification
MAX_TOTAL_OPERATIONS = 1500  # of all entries after simplification


def too_large(mechanism: Mechanism, why: str) -> MbdSimError:
    """The error that equations are too long."""
    return MbdSimError(
        f"{mechanism.name}: the equations of motion are too long to read: {why}. Use a smaller mechanism, or make "
        "some of its joints fixed or driven."
    )
