"""The name of a method of integration, or `auto`."""

from __future__ import annotations

from mbd_sim.errors import MechanismError, Problem, nearest
from mbd_sim.mechanism.records import Mechanism

AUTO = "auto"  # instead of a name: chosen by the rates of the mechanism


def require_method(mechanism: Mechanism, method: str | None) -> str:
    """The name of the method that was asked for: `method`, or that of the mechanism's file; it may be `auto`.

    :raises MechanismError: there is no such method.
    """
    name = method or mechanism.method
    if name == AUTO:
        return name
    from mbd_sim.integrators.methods import METHODS

    if name in METHODS:
        return name
    message, remedy = f"there is no method '{name}'", nearest(name, (AUTO, *METHODS))
    if method:
        raise MechanismError([Problem(message, remedy, key="method")])
    raise MechanismError([mechanism.source.problem(("integrator", "method"), message, remedy)])
