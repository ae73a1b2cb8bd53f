"""The stepper of a model with one-sided rows."""

from __future__ import annotations

from mbd_sim.base.geometry.pose import Array
from mbd_sim.dynamics.constraints.start import rheonomic
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.simulation.contact.events import OneSidedStepper
from mbd_sim.simulation.contact.terms import guard_tolerance
from mbd_sim.simulation.model.model import Model


def one_sided_stepper(model: Model, mechanism: Mechanism) -> OneSidedStepper:
    """The stepper of a model with one-sided rows; contacts come to rest below the `rest_speed` of the mechanism."""
    assert model.one_sided is not None

    def energy(time: float, y: Array, inputs: Array) -> float:
        return model.energies(time, y, 0.0, inputs).total

    return OneSidedStepper(
        model.one_sided,
        energy,
        model.u_range,
        model.loss_range,
        mechanism.rest_speed,
        guard_tolerance(model.equations),
        rheonomic(mechanism),
    )
