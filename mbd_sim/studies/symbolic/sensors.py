"""What sensors measure, without their errors and delays, as simplified SymPy expressions."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, assert_never

import casadi as ca
import numpy as np
import sympy as sp

from mbd_sim.analysis.mechanics.load_sharing import LoadSharing
from mbd_sim.base.errors import MbdSimError
from mbd_sim.base.short_repr import record
from mbd_sim.dynamics.actuators.forces import actuator_forces, add_effort, port_motion
from mbd_sim.dynamics.actuators.functions import MOTOR_READINGS, actuator_functions
from mbd_sim.dynamics.constraints.equations import ConstraintEquations, constraint_equations, joined
from mbd_sim.dynamics.equations import Equations
from mbd_sim.dynamics.forces.elements import element_forces
from mbd_sim.dynamics.kinematics.state_variables import StateVariables
from mbd_sim.dynamics.kinematics.tracing import TracedMechanism, trace
from mbd_sim.dynamics.kinematics.wrenches import AppliedWrenches
from mbd_sim.dynamics.lagrange import MassMoments, spatial_inertia, with_springs
from mbd_sim.dynamics.measurements import exact_values, measured_values
from mbd_sim.dynamics.recursion.reactions import joint_reactions, joint_springs, transmitted_wrenches
from mbd_sim.dynamics.terms import link_accelerations, weight
from mbd_sim.mechanism.elements.actuators import CoordinatePort, LinePort, SumPort, WrenchPort
from mbd_sim.mechanism.elements.parts import PartFrame
from mbd_sim.mechanism.elements.sensors import (
    ORIENTATION,
    AnySensor,
    Encoder,
    ForceTorque,
    FramelessSensor,
    MotorCurrent,
    RangeFinder,
)
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.natural_units import natural_units
from mbd_sim.studies.algebra.evaluation import exact_expression
from mbd_sim.studies.algebra.polynomial import Algebra, Polynomial
from mbd_sim.studies.algebra.samples import SymbolicValues
from mbd_sim.studies.symbolic.actuators import SymbolicActuator, state_and_inputs
from mbd_sim.studies.symbolic.constraints import row_order
from mbd_sim.studies.symbolic.expressions import simplified

INDEX = "index"
TOO_LONG = "too long to be written out"
SHARED = "indeterminate, because redundant constraints share the loads"
EFFORT = MOTOR_READINGS.index("effort")
NEARBY = 3  # configurations in which loads are compared
SAME = 1e-9
DIRECTION_ROUND_OFF = 1e-15  # of entries of a unit vector


@record
class SymbolicSensor:
    """What a sensor measures, without its errors and its delay.

    `values` has a SymPy matrix for each quantity, in SI units: (3, 1) in the axes that the sensor has, (1, 1), or the
    rotation matrix (3, 3) of an `orientation`, from the axes of the sensor to ground's. They depend on t, q, u, u', on
    the multipliers, and on efforts and states of actuators. The position of an encoder is rounded down to its steps,
    and `index` is 1 or 0. The distance of a range finder is that where its beam meets the plane, within its limits.

    A sensor without a formula has no values; `reason` says why, and is empty otherwise.
    """

    sensor: AnySensor
    values: Mapping[str, Any]
    reason: str = ""


@dataclass(frozen=True, eq=False)
class TracedSensors:
    """For each sensor a function of (t, y, inputs, u', λ, efforts of actuators), or why it has no formula."""

    traced: TracedMechanism
    functions: Mapping[str, ca.Function | str]


def traced_sensors(mechanism: Mechanism, values: SymbolicValues | None, derived: Equations | None) -> TracedSensors:
    """Trace what the sensors measure.

    :param derived: the equations of a mechanism with constraints or contacts; None without any.
    """
    numbers = None if values is None else values.numbers
    traced = derived.measurements.traced if derived else trace(mechanism, parameters=numbers)
    rows = _rows(traced, derived)
    u_rates, multipliers = ca.SX.sym("du", traced.layout.nv), ca.SX.sym("lambda", len(rows.rows))
    efforts = ca.SX.sym("f", len(mechanism.actuators))
    links = link_accelerations(traced, u_rates, weight(traced))
    reactions = ca.SX(6, len(mechanism.all_joints))
    if any(isinstance(sensor, ForceTorque) for sensor in mechanism.sensors):
        moments = None if values is None else values.moments
        reactions = _reactions(_with_moments(traced, moments), links, rows, multipliers, efforts)
    given = [traced.state.t, traced.y, traced.inputs, u_rates, multipliers, efforts]
    currents = _currents(traced)
    functions: dict[str, ca.Function | str] = {}
    for sensor in traced.mechanism.sensors:
        exact = exact_values(traced, links, reactions, currents, _with_clean_axes(sensor))
        function = ca.Function("sensor", given, [ca.sparsify(measured_values(sensor, exact))], {"cse": True})
        shared = isinstance(sensor, ForceTorque) and derived is not None and _is_shared(derived, sensor, function)
        functions[sensor.name] = SHARED if shared else function
    return TracedSensors(traced, functions)


def symbolic_sensors(
    found: TracedSensors,
    algebra: Algebra,
    inputs: Sequence[Sequence[Polynomial]],
    actuators: Sequence[SymbolicActuator],
    further: Sequence[Sequence[Any]],
) -> tuple[SymbolicSensor, ...]:
    """The sensors as expressions.

    :param inputs: the polynomials of t, q, u, the efforts, and the parameters, if there are any.
    :param further: the symbols of u' (nv,) and of the multipliers (m,).
    """
    polynomials = [*state_and_inputs(found.traced, algebra, inputs, actuators)]
    efforts = [actuator.effort for actuator in actuators]
    polynomials += [[algebra.symbol(symbol) for symbol in group] for group in (*further, efforts)]
    without_laws = {actuator.name for actuator in actuators if actuator.law is None}
    sensors = []
    for sensor in found.traced.numeric.sensors:
        function = found.functions[sensor.name]
        if isinstance(sensor, MotorCurrent) and sensor.actuator in without_laws:
            function = TOO_LONG
        sensors.append(_symbolic(found.traced.numeric, sensor, function, algebra, polynomials))
    return tuple(sensors)


def _symbolic(
    mechanism: Mechanism,
    sensor: AnySensor,
    function: ca.Function | str,
    algebra: Algebra,
    inputs: Sequence[Sequence[Polynomial]],
) -> SymbolicSensor:
    if isinstance(function, str):
        return SymbolicSensor(sensor, {}, function)
    algebra.products = 0  # the limit is that of each sensor
    try:
        (column,) = simplified(mechanism, algebra, function, inputs)
    except MbdSimError:
        return SymbolicSensor(sensor, {}, TOO_LONG)
    return SymbolicSensor(sensor, _as_signal(sensor, _by_quantity(sensor, [entry for (entry,) in column])))


def _by_quantity(sensor: AnySensor, entries: list[Any]) -> dict[str, Any]:
    """The matrices of the quantities, from the exact values one after the other."""
    found, first = {}, 0
    for quantity in sensor.quantities:
        size = 9 if quantity is ORIENTATION else len(quantity.components)
        own, first = entries[first : first + size], first + size
        found[quantity.name] = sp.Matrix(3, 3, own).T if quantity is ORIENTATION else sp.Matrix(size, 1, own)
    return found


def _as_signal(sensor: AnySensor, values: dict[str, Any]) -> dict[str, Any]:
    """The position of an encoder in whole steps, and its index pulse."""
    if not isinstance(sensor, Encoder):
        return values
    step = 2 * sp.pi / sensor.counts if sensor.counts else exact_expression(sensor.resolution)
    count = values["position"].applyfunc(lambda position: sp.floor(position / step))
    found = {"position": step * count}
    if sensor.index is not None:
        at_index = count - sp.ones(1, 1) * math.floor(sensor.index / sensor.resolution)
        in_turn = at_index if sensor.counts is None else at_index.applyfunc(lambda one: sp.Mod(one, sensor.counts))
        found[INDEX] = in_turn.applyfunc(lambda one: sp.Piecewise((1, sp.Eq(one, 0)), (0, True)))
    return found


def _with_clean_axes(sensor: AnySensor) -> AnySensor:
    """The sensor without the round-off of zeros in its directions, which would be terms of the formulas."""
    if isinstance(sensor, FramelessSensor):
        return sensor
    changes: dict[str, Any] = {"at": _cleaned_frame(sensor.at)}
    if isinstance(sensor, RangeFinder):
        changes["target"] = _cleaned_frame(sensor.target)
        changes["normal"] = None if sensor.normal is None else _cleaned(sensor.normal)
    return replace(sensor, **changes)


def _cleaned_frame(frame: PartFrame) -> PartFrame:
    return replace(frame, pose=replace(frame.pose, rotation=_cleaned(frame.pose.rotation)))


def _cleaned(directions: Any) -> Any:
    """Entries of unit vectors, of which some may be symbols, without the round-off of zeros."""
    entries = ca.densify(ca.SX(directions))
    for index in range(entries.numel()):
        if entries[index].is_constant() and abs(float(entries[index])) <= DIRECTION_ROUND_OFF:
            entries[index] = 0
    return entries


def _rows(traced: TracedMechanism, derived: Equations | None) -> ConstraintEquations:
    """The rows of G in the order of `SymbolicEquations.rows`."""
    if derived is None:
        return constraint_equations(traced)
    rows = derived.measurements.constraints.select(derived.start.independent)
    if derived.one_sided is None:
        return rows
    contacts = derived.one_sided.equations
    return joined(rows, contacts.combined.written.select(row_order(contacts)))


def _reactions(
    traced: TracedMechanism, links: Sequence[ca.SX], rows: ConstraintEquations, multipliers: ca.SX, efforts: ca.SX
) -> ca.SX:
    """The wrenches across the joints by Newton and Euler, with symbols for multipliers and efforts of actuators."""
    state = traced.state
    variables = StateVariables(traced.links, state.t, state.q, state.u)
    elements = element_forces(traced.mechanism, traced.links, traced.motions, traced.poses, variables)
    applied = AppliedWrenches(traced.links, traced.motions, traced.poses)
    for number, actuator in enumerate(traced.mechanism.actuators):
        match actuator.port:
            case LinePort() | WrenchPort():
                add_effort(applied, actuator.port, port_motion(traced, actuator), efforts[number])
            case CoordinatePort() | SumPort():
                pass  # act within joints
            case _:
                assert_never(actuator.port)
    wrenches = [
        ca.sparsify(one + more + unit @ multipliers)
        for one, more, unit in zip(elements.wrenches, applied.wrenches, rows.wrenches, strict=True)
    ]
    transmitted = transmitted_wrenches(traced.links, traced.motions, links, wrenches)
    return joint_reactions(traced, transmitted, rows, multipliers) + joint_springs(traced)


def _with_moments(traced: TracedMechanism, moments: Mapping[str, MassMoments] | None) -> TracedMechanism:
    """With masses and moments of parts that are symbols in the inertias of the links."""
    if moments is None:
        return traced
    links = []
    for link in traced.links:
        name = link.joint.outboard
        inertia: Any = spatial_inertia(with_springs(traced.mechanism, name, moments[name]), link.X_LB)
        links.append(replace(link, inertia=inertia))
    return replace(traced, links=links)


def _is_shared(derived: Equations, sensor: ForceTorque, function: ca.Function) -> bool:
    """Whether the load depends on multipliers of redundant rows, judged by numbers near the start.

    It does not in a plane linkage under loads in its plane, though some of its rows are redundant in space.
    """
    independent = list(derived.start.independent)
    if len(independent) == len(derived.rows):
        return False
    if derived.one_sided is not None:
        return True
    sharing, inputs, random = (
        LoadSharing(derived.mechanism, derived),
        derived.inputs_without_commands,
        np.random.default_rng(3),
    )
    units = natural_units(derived.mechanism, derived.step)
    least = units.force * np.array([1.0, units.length])
    number, nq = [*derived.mechanism.all_joints].index(sensor.joint), derived.layout.nq
    for t, q in derived.start.nearby[:NEARBY]:
        free = derived.constraints.free_directions(t, q)
        y = derived.start_state.copy()
        y[:nq], y[nq : nq + derived.layout.nv] = q, free @ random.normal(size=free.shape[1])
        u_rates = np.array(derived.rates.call([t, y, inputs])[0]).ravel()[nq : nq + derived.layout.nv]
        multipliers = np.array(derived.multipliers(t, y, inputs)).ravel()[independent]
        efforts = [] if derived.actuators is None else np.array(derived.actuators.readings(t, y, inputs))[EFFORT]
        found = np.array(function(t, y, inputs, u_rates, multipliers, efforts)).ravel()
        expected = sharing.reactions(t, y, inputs)[number]
        sizes, others = (np.linalg.norm(np.reshape(load, (2, 3)), axis=1) for load in (found, expected))
        if not np.allclose(sizes, others, rtol=SAME, atol=SAME * np.maximum(least, np.max(others))):
            return True
    return False


def _currents(traced: TracedMechanism) -> ca.SX:
    """The currents (n,) of the actuators."""
    if not traced.mechanism.actuators:
        return ca.SX(0, 1)
    functions = actuator_functions(traced, actuator_forces(traced))
    (readings,) = functions.readings.call([traced.state.t, traced.y, traced.inputs])
    return ca.sparsify(readings[MOTOR_READINGS.index("current"), :].T)
