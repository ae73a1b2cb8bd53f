"""The stepper of a model with one-sided rows."""

from __future__ import annotations

from mbd_sim.dynamics.initial_conditions import rheonomic
from mbd_sim.geometry.pose import Array
from mbd_sim.mechanism.records import Mechanism
from mbd_sim.simulation.compiled_model import Model
from mbd_sim.simulation.contact_events import ContactStepper
from mbd_sim.simulation.contact_system import guard_tolerance


def contact_stepper(model: Model, mechanism: Mechanism) -> ContactStepper:
    """The stepper of a model with one-sided rows; contacts come to rest below the `rest_speed` of the mechanism."""
    assert model.contact is not None

    def energy(time: float, y: Array, inputs: Array) -> float:
        return model.energies(time, y, 0.0, inputs).total

    return ContactStepper(
        model.contact,
        energy,
        model.u_range,
        model.loss_range,
        mechanism.rest_speed,
        guard_tolerance(model.equations),
        rheonomic(mechanism),
    )
