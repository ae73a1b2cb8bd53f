"""The energies that are integrated for the audit."""

from __future__ import annotations

from mbd_sim.mechanism.one_sided import has_one_sided
from mbd_sim.mechanism.records import Mechanism

AUDIT_STATES = ("work_applied", "work_drives", "dissipated")  # J, at the end of the integrated state y in this order
LOSS_STATES = ("impact_loss", "friction_loss")  # J, parts of the dissipated energy, before them if there are contacts


def audit_states(mechanism: Mechanism) -> tuple[str, ...]:
    """The energies that are integrated with the state, in J and in their order after q and u."""
    return (*LOSS_STATES, *AUDIT_STATES) if has_one_sided(mechanism) else AUDIT_STATES
