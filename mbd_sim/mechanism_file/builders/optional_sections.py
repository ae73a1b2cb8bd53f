"""The builders of the sections that many files do not have: each is imported for a section that is not empty."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from mbd_sim.mechanism.records import Joint
from mbd_sim.mechanism_file.builders.build_context import BuildContext
from mbd_sim.mechanism_file.builders.elements import ForceElements

if TYPE_CHECKING:
    from mbd_sim.mechanism.actuators import Actuator
    from mbd_sim.mechanism.bases import Base
    from mbd_sim.mechanism.constraints import Constraint
    from mbd_sim.mechanism.contacts import Contact
    from mbd_sim.mechanism.sensors import AnySensor
    from mbd_sim.mechanism_file.schema.actuator_schema import AnyActuatorSpec
    from mbd_sim.mechanism_file.schema.constraint_schema import AnyConstraintSpec
    from mbd_sim.mechanism_file.schema.contact_schema import ContactSpec
    from mbd_sim.mechanism_file.schema.file_schema import PartSpec
    from mbd_sim.mechanism_file.schema.force_schema import AnyForceSpec
    from mbd_sim.mechanism_file.schema.sensor_schema import AnySensorSpec
    from mbd_sim.mechanism_file.schema.wheeled_base_schema import AnyBaseSpec


def build_force_elements(
    specs: Mapping[str, AnyForceSpec], joints: Mapping[str, Joint | None], context: BuildContext
) -> ForceElements:
    """See `force_builder`."""
    if not specs:
        return ForceElements()
    from mbd_sim.mechanism_file.builders import force_builder

    return force_builder.build_force_elements(specs, joints, context)


def build_constraints(
    specs: Mapping[str, AnyConstraintSpec], joints: Mapping[str, Joint | None], context: BuildContext
) -> tuple[Constraint, ...]:
    """See `constraint_builder`."""
    if not specs:
        return ()
    from mbd_sim.mechanism_file.builders import constraint_builder

    return constraint_builder.build_constraints(specs, joints, context)


def coupled_joints(constraints: Sequence[Constraint], joints: Mapping[str, Joint]) -> list[str]:
    """See `constraint_builder`."""
    if not constraints:
        return []
    from mbd_sim.mechanism_file.builders import constraint_builder

    return constraint_builder.coupled_joints(constraints, joints)


def build_contacts(
    specs: Mapping[str, ContactSpec], parts: Mapping[str, PartSpec], context: BuildContext
) -> tuple[Contact, ...]:
    """See `contact_builder`."""
    if not specs:
        return ()
    from mbd_sim.mechanism_file.builders import contact_builder

    return contact_builder.build_contacts(specs, parts, context)


def build_actuators(
    specs: Mapping[str, AnyActuatorSpec], joints: Mapping[str, Joint | None], context: BuildContext
) -> tuple[Actuator, ...]:
    """See `actuator_builder`."""
    if not specs:
        return ()
    from mbd_sim.mechanism_file.builders import actuator_builder

    return actuator_builder.build_actuators(specs, joints, context)


def actuated_joints(actuators: tuple[Actuator, ...], joints: Mapping[str, Joint]) -> list[str]:
    """See `actuator_builder`."""
    if not actuators:
        return []
    from mbd_sim.mechanism_file.builders import actuator_builder

    return actuator_builder.actuated_joints(actuators, joints)


def build_sensors(
    specs: Mapping[str, AnySensorSpec],
    joints: Mapping[str, Joint | None],
    actuators: Sequence[Actuator],
    step: float | None,
    context: BuildContext,
) -> tuple[AnySensor, ...]:
    """See `sensor_builder`."""
    if not specs:
        return ()
    from mbd_sim.mechanism_file.builders import sensor_builder

    return sensor_builder.build_sensors(specs, joints, actuators, step, context)


def measured_joints(sensors: Sequence[AnySensor], joints: Mapping[str, Joint]) -> set[str]:
    """See `sensor_builder`."""
    if not sensors:
        return set()
    from mbd_sim.mechanism_file.builders import sensor_builder

    return sensor_builder.measured_joints(sensors, joints)


def build_bases(
    specs: Mapping[str, AnyBaseSpec], joints: Mapping[str, Joint], actuators: Sequence[Actuator], context: BuildContext
) -> tuple[Base, ...]:
    """See `base_builder`."""
    if not specs:
        return ()
    from mbd_sim.mechanism_file.builders import base_builder

    return base_builder.build_bases(specs, joints, actuators, context)
