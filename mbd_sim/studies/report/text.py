"""The report of `mbd_sim check` about a mechanism, as text; reports that were made before come from the cache."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from itertools import groupby
from typing import Any

from mbd_sim.base.disk_cache import cached, casadi_version, records_digest
from mbd_sim.base.errors import counted, listed, printable
from mbd_sim.mechanism.mechanism import Mechanism

POSITION_ROUND_OFF = 1e-14  # relative to the size of the mechanism
LISTED = 60  # open elements of a contact that each have a line
NUMBERED = re.compile(r"_\d+$")  # of corners and slots of a pair


def report_text(found: dict[str, Any]) -> str:
    """The report, see `mbd_sim.studies.report.mechanism_report.report`, as text."""
    return printable("\n".join([*_structure(found), *_dynamics(found), *_remarks(found)]), keep="\n")


def kinematic_text(found: dict[str, Any]) -> str:
    """The report on a mechanism without equations of motion, see `kinematic_report`, as text."""
    head, *others = found["dynamics"]
    reasons = [f"Dynamics            not defined: {head}", *(f"                    {text}" for text in others)]
    lines = [*_structure(found), *_mass_and_gravity(found), *reasons, *_remarks(found)]
    return printable("\n".join(lines), keep="\n")


def _structure(found: dict[str, Any]) -> list[str]:
    """Parts, joints and degrees of freedom."""
    return [
        f"{found['mechanism']}: {found['description'] or 'no description'}",
        f"  from {found['file']}",
        "",
        *_parameters(found["parameters"]),
        f"{'part':16s} {'mass kg':>10s}  {'center of mass m':28s} shapes",
        *(
            f"{part['name']:16s} {part['mass']:10.4g}  {_vector(part['center'], _size(found)):28s} "
            f"{', '.join(part['shapes'])}"
            for part in found["parts"]
        ),
        "",
        f"{'joint':16s} {'type':12s} {'between':28s} {'axis':22s} start",
        *(
            f"{joint['name']:16s} {joint['type']:12s} {joint['parent'] + ' – ' + joint['child']:28s} "
            f"{_axes(joint):22s} {_start(joint, found)}".rstrip()
            for joint in found["joints"]
        ),
        *_forces(found["forces"]),
        *_actuators(found["actuators"]),
        "",
        *_mobility(found),
        *(
            f"Driven              {name} = {text}"
            for joint in found["joints"]
            for name, text in zip(joint["coordinates"], joint["drive"], strict=False)
        ),
        *(f"Base                {_base(base)}" for base in found["bases"]),
        *(f"Sensor              {_sensor(sensor)}" for sensor in found["sensors"]),
        *(f"Contact             {name}: not active, see 'active' in the file" for name in found["inactive_contacts"]),
    ]


def _parameters(parameters: dict[str, dict[str, Any]]) -> list[str]:
    """A table of the parameters, with what the file gives where this is not the number itself."""
    if not parameters:
        return []
    rows = []
    for name, one in parameters.items():
        value = f"{one['value']:.9g}"
        given = " ".join(one["given"].split())
        rows.append(f"{name:16s} {value:>16s}  {'' if _is_same(given, one['value']) else given}".rstrip())
    return [f"{'parameter':16s} {'value in SI':>16s}  given as", *rows, ""]


def _is_same(given: str, value: float) -> bool:
    """Whether a text is a number without a unit, which says no more than the value."""
    try:
        return float(given) == value
    except ValueError:
        return False


def _base(base: dict[str, Any]) -> str:
    steering = f", steered by {', '.join(base['steering'])}" if base["steering"] else ""
    return f"{base['name']}: {base['type']}, on the wheels {', '.join(base['wheels'])}{steering}"


def _sensor(sensor: dict[str, Any]) -> str:
    timing = f"{sensor['rate']:.6g} Hz"
    timing += f", {sensor['delay']:g} s later" if sensor["delay"] else ""
    timing += f", {100.0 * sensor['drop_out']:g} % lost" if sensor["drop_out"] else ""
    errors = "; ".join(
        f"{quantity} {', '.join(f'{key} {value:g}' for key, value in errors.items())} {sensor['units'][quantity]}"
        for quantity, errors in sensor["errors"].items()
    )
    return f"{sensor['name']}: {sensor['type']} at {sensor['at']}, {timing}; {errors or 'no errors'}"


def _forces(forces: list[dict[str, Any]]) -> list[str]:
    """A table of the force elements, with what each depends on."""
    if not forces:
        return []
    rows = [
        f"{force['name']:16s} {force['type']:18s} {force['at']:28s} {', '.join(force['depends_on']) or 'constant'}"
        for force in forces
    ]
    return ["", f"{'force':16s} {'type':18s} {'acts on':28s} depends on", *rows]


def _actuators(actuators: list[dict[str, Any]]) -> list[str]:
    """A table of the actuators, with the commands that each takes."""
    if not actuators:
        return []
    rows = [
        f"{actuator['name']:16s} {actuator['type']:18s} {actuator['at']:28s} {_servo(actuator):22s} "
        f"{_commands(actuator):30s} {', '.join(actuator['limits'])}".rstrip()
        for actuator in actuators
    ]
    return ["", f"{'actuator':16s} {'type':18s} {'acts on':28s} {'servo':22s} {'commands':30s} limits", *rows]


def _servo(actuator: dict[str, Any]) -> str:
    rate = "" if actuator["sample_rate"] is None else f", {actuator['sample_rate']:.6g} Hz"
    return (actuator["servo"] or "none") + rate


def _commands(actuator: dict[str, Any]) -> str:
    return ", ".join(actuator["commands"]) + (f", {actuator['delay']:g} s later" if actuator["delay"] else "")


def _mass_and_gravity(found: dict[str, Any]) -> list[str]:
    return [f"Total mass          {found['mass']:.6g} kg", f"Gravity             {_vector(found['gravity'])} m/s²"]


def _remarks(found: dict[str, Any]) -> list[str]:
    return [f"Remark              {remark}" for remark in found["remarks"]]


def _dynamics(found: dict[str, Any]) -> list[str]:
    """Energies, mass matrix, small motions and the integrator."""
    start, integrator = found["start"], found["integrator"]
    weight = found["mass"] * math.hypot(*found["gravity"])
    scale = max(abs(start["kinetic"]), weight * found["size"])
    return [
        *_mass_and_gravity(found),
        f"Initial energies    kinetic {_rounded(start['kinetic'], scale):.6g} J, "
        f"potential {_rounded(start['potential'], scale):.6g} J, total {_rounded(start['total'], scale):.6g} J",
        *_mass(found["mass_matrix"]),
        *_inertia_forces(found["inertia_forces"]),
        *_one_sided(found),
        *_compliant_contacts(found["compliant_contacts"], _size(found)),
        *_motions(found["small_motions"]),
        f"Integrator          {integrator['method']} (order {integrator['order']}), step {integrator['step']:g} s, "
        f"{integrator['instructions_per_evaluation']} instructions per evaluation",
    ]


def _one_sided(found: dict[str, Any]) -> list[str]:
    """The one-sided elements, and what they take away of the degrees of freedom at the start."""
    elements = found["one_sided"]["elements"]
    if not elements:
        return []
    left, free = found["one_sided"]["degrees_of_freedom"], found["degrees_of_freedom"]
    some = "1 element leaves" if len(elements) == 1 else f"{len(elements)} elements leave"
    head = f"One-sided           {some} {left} of {free} degrees of freedom at the start"
    return [head, *_contact_lines(elements, _size(found))]


def _compliant_contacts(elements: dict[str, Any], size: float) -> list[str]:
    """The compliant contacts at the start."""
    return [f"Compliant contacts  {len(elements)}", *_contact_lines(elements, size)] if elements else []


def _contact_lines(elements: dict[str, Any], size: float) -> Iterator[str]:
    """A line for each element; one for open corners or slots of the same pair whose gaps are equal.

    Of a contact with more than `LISTED` open elements only the nearest one is named.
    """
    opened: dict[str, list[str]] = {}
    for name, element in elements.items():
        if element["state"] == "open":
            opened.setdefault(name.partition(".")[0], []).append(name)
    many = {contact: names for contact, names in opened.items() if len(names) > LISTED}
    for contact, names in many.items():
        nearest = min(names, key=lambda name: float(elements[name]["gap"]))
        gap = f"{_rounded(elements[nearest]['gap'], size):.6g}"
        yield f"  {contact}: {len(names)} open, the nearest is {nearest}, gap {gap}"
    left_out = {name for names in many.values() for name in names}

    def described(item: tuple[str, Any]) -> tuple[str, str]:
        """The name of the pair, or for what is not open of the element, and the state."""
        name, element = item
        if element["state"] == "open":
            return NUMBERED.sub("", name), f"open, gap {_rounded(element['gap'], size):.6g}"
        return name, element["state"] + (f", force {element['normal']:.6g}" if element["normal"] else "")

    for (_, state), group in groupby(elements.items(), described):
        names = [name for name, _ in group if name not in left_out]
        if not names:
            continue
        last = f" to {names[-1].rpartition('_')[2]}" if len(names) > 1 else ""
        yield f"  {names[0]}{last}: {state}"


def _start(joint: dict[str, Any], found: dict[str, Any]) -> str:
    if joint["name"] in found["closing_joints"]:
        return "closes a loop"
    if joint["drive"]:
        return "driven"
    units = joint["position_units"]
    values = [
        _rounded(value, 1.0 if unit == "rad" else _size(found))
        for value, unit in zip(joint["position"], units, strict=False)
    ]
    turned = [
        f"{math.degrees(value):.4g}°" for value, unit in zip(values, units, strict=False) if unit == "rad" and value
    ]
    return _vector(values, 0.0) + (f" ({', '.join(turned)})" if turned else "")


def _mobility(found: dict[str, Any]) -> list[str]:
    """The degrees of freedom by Kutzbach's criterion and by rank, and the kinds of constraints."""
    numbers = found["mobility"]
    removed = str(numbers["joint_equations"])
    if numbers["other_equations"]:
        removed += f" - {numbers['other_equations']}"
    coordinates = ", ".join(found["coordinates"]) or "none"
    planar = "" if numbers["planar_kutzbach"] is None else f", {numbers['planar_kutzbach']} in the plane"
    lines = [
        f"Degrees of freedom  {found['degrees_of_freedom']}  (coordinates: {coordinates})",
        f"  by counting       6·{len(found['parts'])} - {removed} = {numbers['kutzbach']} (Kutzbach){planar}",
    ]
    if numbers["equations"]:
        same = numbers["rank_at_start"] == numbers["rank"]
        lines.append(
            f"  by rank           {counted(numbers['coordinates'], 'coordinate')} - rank {numbers['rank']} of "
            f"{counted(numbers['equations'], 'equation')} = {numbers['degrees_of_freedom']}"
            + ("" if same else f" (rank {numbers['rank_at_start']} at the start)")
        )
    closing = [*found["closing_joints"], *(f"{name} (within {part})" for name, part in found["split_parts"].items())]
    if closing:
        lines.append(f"  loops closed by   {', '.join(closing)}")
        lines += _assembly_modes(found)
    if found["moved"]:
        lines.append(
            "  made exact        axes and points of loops, within the digits of the file (tolerance: 0 keeps them):"
        )
        lines += [f"                    {name} by {_move(move)}" for name, move in found["moved"].items()]
    if numbers["redundant"]:
        lines += [f"  redundant         {text}" for text in _grouped(numbers["redundant"])]
        degree, stated = numbers["static_indeterminacy"], found["stated_compliances"]
        how = f"the compliances of {listed(stated)}" if stated else "the least sum of squares"
        lines.append(f"  indeterminate     statically, to degree {degree}: reactions determined by {how}")
    time_dependence = "scleronomic" if found["scleronomic"] else "rheonomic (time-dependent)"
    if "constraints" not in found:
        return [*lines, f"Constraints         {time_dependence}"]
    lines.append(f"Constraints         {_kind(found)}, {time_dependence}")
    for row in found["constraints"]:
        if not row["holonomic"]:
            verdict = "integrable, so it also restricts positions" if row["integrable"] else "not integrable"
            lines.append(f"  nonholonomic      {row['name']}: {verdict}")
    return lines


def _move(move: dict[str, float]) -> str:
    """By how much a joint was moved; what is round-off is left out."""
    sizes = (1e3 * move["distance"], "mm", 1e-9), (math.degrees(move["angle"]), "°", 1e-11)
    return " and ".join(f"{size:.3g} {unit}".replace(" °", "°") for size, unit, least in sizes if size > least)


def _assembly_modes(found: dict[str, Any]) -> list[str]:
    """The command that lists all configurations in which the loops close, for mechanisms that it accepts."""
    if not found.get("holonomic") or found["degrees_of_freedom"] < 1:
        return []
    drive = f"{found['coordinates'][0]}=VALUE" if found["degrees_of_freedom"] == 1 else "NAME=VALUE …"
    return [f"  other modes       they may close in other ways too: mbd_sim kinematics FILE --drive {drive} --modes"]


def _kind(found: dict[str, Any]) -> str:
    if all(row["holonomic"] for row in found["constraints"]):
        return "holonomic"
    return "holonomic (the velocity constraints are integrable)" if found["holonomic"] else "nonholonomic"


def _grouped(names: list[str]) -> list[str]:
    """The equations of each joint or constraint on one line."""
    found: dict[str, list[str]] = {}
    for name in names:
        owner, _, what = name.rpartition(": ")
        found.setdefault(owner, []).append(what)
    return [f"{owner}: {'; '.join(what)}" for owner, what in found.items()]


def _mass(matrix: dict[str, Any]) -> list[str]:
    regular = "positive definite" if matrix["positive_definite"] else "singular"
    t2, t1, t0 = _all_rounded([matrix[name] for name in ("T2", "T1", "T0")])
    condition = matrix["condition"]
    free = "nothing is free to move" if condition is None else f"condition number {condition:.3g} at the start"
    return [
        f"Mass matrix         {regular}, {free}",
        f"Kinetic energy      T2 {t2:.6g} J (quadratic in the speeds), T1 {t1:.6g} J (linear), "
        f"T0 {t0:.6g} J (constant)",
    ]


def _inertia_forces(terms: dict[str, Any] | None) -> list[str]:
    """The terms of d/dt(∂T/∂q') - ∂T/∂q in a driven mechanism, and the gyroscopic matrix if it is not zero."""
    if terms is None:
        return []
    complementary = [a + b for a, b in zip(terms["gyroscopic"], terms["unsteady"], strict=True)]
    largest = max(abs(value) for row in (terms["relative"], terms["transport"], complementary) for value in row)
    relative, transport, coriolis = (
        _vector(row, largest) for row in (terms["relative"], terms["transport"], complementary)
    )
    lines = [f"Inertia forces      relative {relative}, transport {transport}, Coriolis {coriolis} at the start"]
    if (largest := max(abs(value) for row in terms["gyroscopic_matrix"] for value in row)) > 0.0:
        rows = ", ".join(_vector(row, largest) for row in terms["gyroscopic_matrix"])
        lines.append(f"  gyroscopic matrix [{rows}]: skew-symmetric, does no work")
    return lines


def _motions(small: dict[str, Any]) -> list[str]:
    if small["equilibrium"] is None:
        return [f"Equilibrium         not determined: {small['reason']}"]
    named = zip(small["coordinates"], small["equilibrium"], strict=True)
    unstable = "" if small["stable"] else " (unstable)"
    place = ", ".join(f"{name} = {_rounded(value):.4g}" for name, value in named)
    lines = [f"Equilibrium         at {place}{unstable}"]
    for mode in small["modes"]:
        if mode["frequency"]:
            lines.append(
                f"  natural mode      {mode['frequency']:.6g} Hz, damping ratio {_rounded(mode['damping']):.4g}"
            )
        elif mode["growth"]:
            verb = "grows" if mode["growth"] > 0.0 else "decays"
            constant = 1.0 / abs(mode["growth"])
            lines.append(f"  natural mode      {verb} without oscillation, time constant {constant:.4g} s")
    if zeros := sum(not mode["frequency"] and not mode["growth"] for mode in small["modes"]):
        lines.append(f"  neutral           zero eigenvalues: {zeros} (no force restores the position)")
    return lines


def _axes(joint: dict[str, Any]) -> str:
    lead = f", {joint['lead']:g} m per turn" if joint["lead"] else ""
    return " ".join(_vector(axis) for axis in joint["axes"]) + lead


def _size(found: dict[str, Any]) -> float:
    """The size of the mechanism in m, to compare its lengths with."""
    return float(found.get("size", 1.0))


def _vector(values: list[float], scale: float = 1.0) -> str:
    return "[" + ", ".join(f"{_rounded(value, scale):.4g}" for value in values) + "]" if values else ""


def _all_rounded(values: list[float]) -> list[float]:
    """The values, or 0 where they are round-off in comparison with the largest."""
    return [_rounded(value, max(map(abs, values))) for value in values]


def _rounded(value: float, scale: float = 1.0) -> float:
    """The value, or 0 where it is round-off in comparison with `scale`."""
    return value if abs(value) > POSITION_ROUND_OFF * scale else 0.0


def cached_report(mechanism: Mechanism) -> dict[str, Any]:
    """The contents of `report`, found by everything that they depend on; a mechanism is built only if need be.

    :raises MechanismError: see `Simulation`.
    """

    def made() -> dict[str, Any]:
        from mbd_sim.simulation.run.simulation import BaseSimulation
        from mbd_sim.studies.report.mechanism_report import report

        return report(BaseSimulation(mechanism))

    return cached(made, "report", records_digest(mechanism), casadi_version())
