"""The report of `mbd_sim check` about a mechanism, as data."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from mbd_sim.analysis.equilibria.equilibrium import is_autonomous, nearest_equilibrium
from mbd_sim.analysis.linear.linearization import linearize, modes
from mbd_sim.analysis.mechanics.inverse_dynamics import inertia_split
from mbd_sim.analysis.mechanics.kinematics import Kinematics
from mbd_sim.analysis.mechanics.mobility import Mobility, integrable_rows, mobility
from mbd_sim.base.errors import Problem
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.geometry.rotation import rotation_vector
from mbd_sim.dynamics.constraints.start import rheonomic
from mbd_sim.dynamics.equations import Equations
from mbd_sim.mechanism.contents import has_actuator_states
from mbd_sim.mechanism.elements.actuators import Base
from mbd_sim.mechanism.elements.joint_types import STATES, CommandedDrive
from mbd_sim.mechanism.elements.parts import Joint, Part
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.mechanism.natural_units import natural_units
from mbd_sim.simulation.contact.complementarity import independent
from mbd_sim.simulation.contact.readings import compliant_names
from mbd_sim.simulation.run.simulation import BaseSimulation
from mbd_sim.studies.report.elements import actuator_report, force_reports, sensor_report

LINEARIZED = 4000  # instructions for the accelerations up to which the report linearizes them


def report(simulation: BaseSimulation) -> dict[str, Any]:
    """The contents of the report, in SI units."""
    mechanism, equations = simulation.mechanism, simulation.model.equations
    energies = simulation.energies
    counted = mobility(mechanism, equations.rows, equations.start, simulation.poses())
    constraints = _constraints(equations)
    names, values = simulation.coordinate_names, simulation.model.coordinates(simulation.state)
    return {
        **_structure(mechanism, counted, dict(zip(names, values.tolist(), strict=True))),
        "constraints": constraints,
        "holonomic": all(row["holonomic"] or row["integrable"] for row in constraints),
        "dynamics": [],
        "size": _size(simulation),
        "start": {"q": simulation.q.tolist(), "u": simulation.u.tolist(), **energies._asdict()},
        "mass_matrix": _mass_matrix(simulation),
        "inertia_forces": _inertia_forces(simulation),
        "small_motions": {
            **_small_motions(equations, simulation.model.kernel.instructions),
            "coordinates": _position_names(equations, mechanism),
        },
        "integrator": {
            "method": simulation.model.method_name,
            "order": simulation.model.method.order,
            "step": simulation.step_size,
            "instructions_per_evaluation": simulation.model.kernel.instructions,
        },
        "one_sided": _one_sided(simulation),
        "compliant_contacts": _contacts(simulation, compliant=True),
        "remarks": [
            *simulation.remarks,
            *_import_notes(mechanism),
        ],
    }


def _one_sided(simulation: BaseSimulation) -> dict[str, Any]:
    """The one-sided elements at the start, and the degrees of freedom that the closed ones leave."""
    contact = simulation.model.one_sided
    if contact is None:
        return {"elements": {}}
    modes = contact.modes(simulation.inputs)
    sliding = set(contact.sliding(modes)).intersection(contact.loaded)  # their rows are solved for, but do not restrict
    active = np.flatnonzero(modes[contact.layout.active])
    matrix = contact.terms(simulation.time, simulation.y, simulation.inputs).matrix
    held = len(independent(matrix, active.tolist())) - len(sliding)
    elements = _contacts(simulation, compliant=False)
    return {"elements": elements, "degrees_of_freedom": simulation.model.degrees_of_freedom - held}


def _contacts(simulation: BaseSimulation, *, compliant: bool) -> dict[str, Any]:
    """The compliant contacts, or all others, at the start."""
    soft = compliant_names(simulation.model.compliant_contacts)
    return {
        name: {"state": state.state, "gap": state.gap, "normal": state.normal, "friction": state.friction.tolist()}
        for name, state in simulation.contacts().items()
        if (name in soft) == compliant
    }


def kinematic_report(kinematics: Kinematics, problems: Sequence[Problem]) -> dict[str, Any]:
    """The contents of the report on a mechanism without equations of motion: those that need no masses.

    :param problems: why there are none.
    """
    mechanism, start = kinematics.mechanism, kinematics.assembled
    counted = mobility(mechanism, kinematics.rows, start, kinematics.poses())
    return {
        **_structure(mechanism, counted, _start_positions(kinematics)),
        "dynamics": [str(problem) for problem in problems],
        "remarks": [*mechanism.source.remarks, *_import_notes(mechanism)],
    }


def _start_positions(kinematics: Kinematics) -> dict[str, float]:
    """The start position of each coordinate; a free or spherical joint has a rotation vector in rad."""
    found: dict[str, float] = {}
    for name, joint in kinematics.mechanism.joints.items():
        values = kinematics.start[kinematics.layout.q[name]]
        if (offset := joint.kind.quaternion) is not None and not joint.drive:
            values = np.concatenate([values[:offset], rotation_vector(values[offset:])])
        found |= dict(zip(joint.coordinate_names, values.tolist(), strict=True))
    return found


def _structure(mechanism: Mechanism, counted: Mobility, at: Mapping[str, float]) -> dict[str, Any]:
    """The contents that every mechanism has; `at` gives the start position of each coordinate."""
    return {
        "mechanism": mechanism.name,
        "description": mechanism.description,
        "file": mechanism.source.file,
        "parameters": _parameters(mechanism),
        "parts": [_part(part) for part in mechanism.parts.values()],
        "joints": [_joint(joint, at) for joint in mechanism.all_joints.values()],
        "forces": force_reports(mechanism),
        "actuators": [actuator_report(actuator) for actuator in mechanism.actuators],
        "spanning_tree": [f"{joint.inboard} -{joint.name}-> {joint.outboard}" for joint in mechanism.tree_joints()],
        "closing_joints": list(mechanism.closing),
        "split_parts": {name: joint.outboard_part for name, joint in mechanism.joints.items() if joint.splits},
        "moved": {name: dataclasses.asdict(move) for name, move in mechanism.moved.items()},
        "mobility": dataclasses.asdict(counted),
        "stated_compliances": [joint.name for joint in mechanism.all_joints.values() if joint.compliance != 1.0],
        "degrees_of_freedom": counted.degrees_of_freedom,
        "scleronomic": not rheonomic(mechanism),
        "driven": list(mechanism.driven_names),
        "coordinates": list(mechanism.coordinate_names),
        "bases": [_base(base) for base in mechanism.bases],
        "sensors": [sensor_report(sensor, mechanism.step) for sensor in mechanism.sensors],
        "inactive_contacts": list(_inactive_contacts(mechanism)),
        "mass": mechanism.mass,
        "gravity": mechanism.gravity.tolist(),
    }


def _parameters(mechanism: Mechanism) -> dict[str, dict[str, Any]]:
    """The value of each parameter in SI units, and what the file gives for it, such as a formula."""
    data = mechanism.source.data
    written = data.get("parameters") if isinstance(data, dict) else None
    given = written if isinstance(written, dict) else {}
    return {
        name: {"value": float(value), "given": str(given.get(name, ""))} for name, value in mechanism.parameters.items()
    }


def _inactive_contacts(mechanism: Mechanism) -> Iterator[str]:
    """The names of contacts that the file only lists. Notes of other formats tell of theirs."""
    entries = mechanism.source.data.get("contacts") if isinstance(mechanism.source.data, dict) else None
    if not isinstance(entries, dict) or mechanism.source.notes:
        return
    yield from (
        str(name) for name, entry in entries.items() if isinstance(entry, dict) and entry.get("active") is False
    )


def _import_notes(mechanism: Mechanism) -> Iterator[str]:
    return (f"from the {mechanism.source.format}, {note}" for note in mechanism.source.notes)


def _constraints(equations: Equations) -> list[dict[str, Any]]:
    """An entry for each equation of loops and constraints."""
    integrable = integrable_rows(equations)
    return [
        {
            "name": row.name,
            "holonomic": row.position is not None,
            "integrable": integrable.get(index, True),
            "redundant": index not in equations.start.independent,
        }
        for index, row in enumerate(equations.rows)
    ]


def _size(simulation: BaseSimulation) -> float:
    """The largest distance of a center of mass from the origin of ground at the start, m."""
    poses, parts = simulation.poses(), simulation.mechanism.parts
    places = [poses[name].position + poses[name].rotation @ part.center for name, part in parts.items()]
    return max((float(np.linalg.norm(place)) for place in places), default=0.0)


def _position_names(equations: Equations, mechanism: Mechanism) -> list[str]:
    """A name for each of the generalized coordinates q, also for the components of quaternions."""
    names: dict[int, str] = {}
    for joint in mechanism.tree_joints():
        first, quaternion = equations.layout.q[joint.name].start, joint.kind.quaternion
        labels = list(joint.motion_names[:quaternion])
        if quaternion is not None:
            labels += [f"{joint.name}.q{letter}" for letter in "wxyz"]
        if not joint.drive:
            names |= {first + index: label for index, label in enumerate(labels)}
    return [names[index] for index in sorted(names)]


def _mass_matrix(simulation: BaseSimulation) -> dict[str, Any]:
    """Whether the mass matrix is regular, and the kinetic energy by degree in the speeds (Lidström, ch. 9)."""
    constraints, q, u = simulation.model.equations.constraints, simulation.q, simulation.u
    mass = constraints.mass_matrix(0.0, q)
    free = constraints.free_directions(0.0, q)
    values = np.linalg.eigvalsh(free.T @ mass @ free)
    forwards, backwards, constant = (_kinetic(simulation, speeds) for speeds in (u, -u, 0.0 * u))
    return {
        "positive_definite": bool(np.all(np.linalg.eigvalsh(mass) > 0.0)),
        "condition": float(values[-1] / values[0]) if len(values) else None,
        "T2": 0.5 * (forwards + backwards) - constant,
        "T1": 0.5 * (forwards - backwards),
        "T0": constant,
    }


def _kinetic(simulation: BaseSimulation, speeds: Array) -> float:
    """The kinetic energy at the start with other speeds, J."""
    y = simulation.state
    y[simulation.model.u_range] = speeds
    return simulation.model.energies(0.0, y).kinetic


GYROSCOPIC = 1e-12  # of the natural unit, up to which an entry of the gyroscopic matrix is round-off


def _inertia_forces(simulation: BaseSimulation) -> dict[str, Any] | None:
    """The inertia forces at the start by origin, or None if nothing is driven."""
    model = simulation.model
    if not model.driven_names or not len(simulation.u):
        return None
    rates = np.array(model.equations.rates.call([0.0, simulation.state, simulation.inputs])[0]).ravel()
    split = inertia_split(model.equations)
    terms = split.at(0.0, simulation.q, simulation.u, rates[model.u_range])
    matrix, sizes = split.gyroscopic_matrix(0.0, simulation.q), model.equations.constraints.scales
    units, scales = natural_units(model.mechanism, model.equations.step), np.outer(sizes, sizes)
    unit = units.mass * units.length**2 * units.rate
    return {
        **{name: values.tolist() for name, values in terms._asdict().items()},
        "gyroscopic_matrix": np.where(np.abs(matrix * scales) > GYROSCOPIC * unit, matrix, 0.0).tolist(),
    }


def _small_motions(equations: Equations, instructions: int) -> dict[str, Any]:
    """The equilibrium nearest to the start and its natural modes, or the reason why they were not computed."""
    nv = equations.layout.nv
    if equations.one_sided is not None:
        return {"equilibrium": None, "reason": "there are one-sided elements, see 'mbd_sim modes'", "modes": []}
    if has_actuator_states(equations.mechanism):
        return {"equilibrium": None, "reason": "there are actuators with states of their own", "modes": []}
    if nv == equations.start.rank or instructions > LINEARIZED:
        no_freedom = nv == equations.start.rank
        reason = "there is no degree of freedom" if no_freedom else "the equations are too large to linearize"
        return {"equilibrium": None, "reason": reason, "modes": []}
    if not is_autonomous(equations):
        return {"equilibrium": None, "reason": "forces or drives depend on time", "modes": []}
    near = nearest_equilibrium(equations)
    if near is None:
        return {"equilibrium": None, "reason": "no equilibrium was found near the start", "modes": []}
    found = modes(linearize(equations, near.q, np.zeros(nv), np.zeros(nv)))
    return {
        "equilibrium": near.q[: equations.layout.nq - STATES * len(equations.layout.drives)].tolist(),
        "displacement": near.displacement.tolist(),
        "distance": near.distance,
        "stable": near.stable,
        "reason": "",
        "modes": [
            {"frequency": mode.frequency, "damping": mode.damping, "growth": mode.eigenvalue.real} for mode in found
        ],
    }


def _drive(joint: Joint) -> list[str]:
    """What drives the coordinates of a joint, in words; empty if nothing does."""
    drive = joint.drive
    if not isinstance(drive, CommandedDrive):
        return [expression.text for expression in drive]
    unit = joint.kind.coordinates[0].unit
    text = f"commanded {drive.controls}, with a bandwidth of {drive.bandwidth:g}/s"
    for what, value, of in (
        ("speed", drive.velocity_limit, f"{unit}/s"),
        ("acceleration", drive.acceleration_limit, f"{unit}/s²"),
    ):
        text += f", {what} up to {value:g} {of}" if value < math.inf else ""
    if (drive.lower, drive.upper) != (-math.inf, math.inf):
        text += f", between {drive.lower:g} and {drive.upper:g} {unit}"
    return [text]


def _base(base: Base) -> dict[str, Any]:
    return {
        "name": base.name,
        "type": base.type,
        "wheels": [wheel.taker for wheel in base.wheels],
        "steering": [steering.taker for steering in base.steering],
    }


def _part(part: Part) -> dict[str, Any]:
    return {
        "name": part.name,
        "mass": part.mass,
        "center": part.center.tolist(),
        "inertia": part.inertia.tolist(),
        "shapes": [shape.kind for shape in part.shapes],
    }


def _joint(joint: Joint, at: Mapping[str, float]) -> dict[str, Any]:
    return {
        "name": joint.name,
        "type": joint.type,
        "parent": joint.parent,
        "child": joint.child,
        "axes": [axis.tolist() for axis in (joint.axis, joint.second) if axis.any()],
        "lead": joint.lead,
        "position": [at[name] for name in joint.motion_names if name in at],
        "position_units": [coordinate.unit for coordinate in joint.kind.coordinates],
        "reversed": joint.reversed,
        "coordinates": list(joint.motion_names),
        "drive": _drive(joint),
    }
