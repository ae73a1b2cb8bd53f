"""Simulation of one mechanism, or of many at once."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mbd_sim.lazy_names import lazy_names

if TYPE_CHECKING:
    from mbd_sim.simulation.actuator_states import efforts_on as efforts_on
    from mbd_sim.simulation.actuator_states import states_of_actuators as states_of_actuators
    from mbd_sim.simulation.compliant_states import compliant_names as compliant_names
    from mbd_sim.simulation.compliant_states import states_of_compliant_contacts as states_of_compliant_contacts
    from mbd_sim.simulation.contact_pairs import require_computable_pairs as require_computable_pairs
    from mbd_sim.simulation.contact_records import with_friction as with_friction
    from mbd_sim.simulation.contact_start import require_free_start as require_free_start
    from mbd_sim.simulation.contact_start import require_outside as require_outside
    from mbd_sim.simulation.contact_stepping import one_sided_stepper as one_sided_stepper
    from mbd_sim.simulation.load_path_reader import LoadPathReader as LoadPathReader
    from mbd_sim.simulation.model_builder import build as build
    from mbd_sim.simulation.model_builder import can_be_stored as can_be_stored
    from mbd_sim.simulation.model_builder import one_sided_model as one_sided_model
    from mbd_sim.simulation.model_builder import partial_system as partial_system
    from mbd_sim.simulation.motions import MotionReaders as MotionReaders
    from mbd_sim.simulation.moving_points import MovingFrame as MovingFrame
    from mbd_sim.simulation.moving_points import MovingPoint as MovingPoint
    from mbd_sim.simulation.part_motion import motion_of as motion_of
    from mbd_sim.simulation.requested_functions import RequestedFunctions as RequestedFunctions
    from mbd_sim.simulation.sensor_model import SensorModel as SensorModel
    from mbd_sim.simulation.sensor_samples import SensorSamples as SensorSamples
    from mbd_sim.simulation.simulation import Simulation as Simulation
    from mbd_sim.simulation.state_values import checked_values as checked_values
    from mbd_sim.simulation.state_values import require_allowed_speeds as require_allowed_speeds
    from mbd_sim.simulation.state_values import state_with as state_with
    from mbd_sim.simulation.step_advice import advice_on_energy as advice_on_energy
    from mbd_sim.simulation.step_advice import advice_on_step as advice_on_step
    from mbd_sim.simulation.step_advice import divergence as divergence
else:
    __getattr__ = lazy_names(
        __name__,
        {
            "actuator_states": ("efforts_on", "states_of_actuators"),
            "contact_pairs": ("require_computable_pairs",),
            "contact_records": ("with_friction",),
            "compliant_states": ("compliant_names", "states_of_compliant_contacts"),
            "contact_stepping": ("one_sided_stepper",),
            "contact_start": ("require_free_start", "require_outside"),
            "load_path_reader": ("LoadPathReader",),
            "model_builder": ("build", "can_be_stored", "one_sided_model", "partial_system"),
            "motions": ("MotionReaders",),
            "moving_points": ("MovingFrame", "MovingPoint"),
            "part_motion": ("motion_of",),
            "requested_functions": ("RequestedFunctions",),
            "sensor_model": ("SensorModel",),
            "sensor_samples": ("SensorSamples",),
            "simulation": ("Simulation",),
            "state_values": ("checked_values", "require_allowed_speeds", "state_with"),
            "step_advice": ("advice_on_energy", "advice_on_step", "divergence"),
        },
    )
