"""What `mbd_sim check` says of a mechanism, in words."""

from __future__ import annotations

from typing import Any


def report_text(found: dict[str, Any]) -> str:
    """The report in words."""
    start, integrator = found["start"], found["integrator"]
    lines = [
        f"{found['mechanism']}: {found['description'] or 'no description'}",
        f"  from {found['file']}",
        "",
        f"{'part':16s} {'mass kg':>10s}  {'mass centre m':28s} shapes",
        *(
            f"{part['name']:16s} {part['mass']:10.4g}  {_vector(part['center']):28s} {', '.join(part['shapes'])}"
            for part in found["parts"]
        ),
        "",
        f"{'joint':16s} {'type':12s} {'between':28s} {'axis':22s} start",
        *(
            f"{joint['name']:16s} {joint['type']:12s} {joint['parent'] + ' – ' + joint['child']:28s} "
            f"{_axes(joint):22s} {_start(joint, found)}".rstrip()
            for joint in found["joints"]
        ),
        "",
        *_mobility(found),
        *(
            f"Driven              {name} = {text}"
            for joint in found["joints"]
            for name, text in zip(joint["coordinates"], joint["drive"], strict=False)
        ),
        f"Total mass          {found['mass']:.6g} kg",
        f"Gravity             {_vector(found['gravity'])} m/s²",
        f"Start energies      kinetic {start['kinetic']:.6g} J, potential {start['potential']:.6g} J, "
        f"total {start['total']:.6g} J",
        *_mass(found["mass_matrix"]),
        *_inertia_forces(found["inertia_forces"]),
        *_motions(found["small_motions"]),
        f"Integrator          {integrator['method']} (order {integrator['order']}), step {integrator['step']:g} s, "
        f"{integrator['instructions_per_evaluation']} instructions for the accelerations",
        *(f"Remark              {remark}" for remark in found["remarks"]),
    ]
    return "\n".join(lines)


def _start(joint: dict[str, Any], found: dict[str, Any]) -> str:
    if joint["name"] in found["closing_joints"]:
        return "closes a loop"
    return "driven" if joint["drive"] else _vector(joint["position"])


def _mobility(found: dict[str, Any]) -> list[str]:
    """The count, then what is true: the rank."""
    counted = found["mobility"]
    taken = f"{counted['joint_equations']}" + (f" - {counted['other_equations']}" if counted["other_equations"] else "")
    coordinates = ", ".join(found["coordinates"]) or "none"
    planar, loose = counted["planar_kutzbach"], counted["equations"] > 0
    lines = [
        f"Degrees of freedom  {found['degrees_of_freedom']}  (coordinates: {coordinates})",
        f"  by counting       6·{len(found['parts'])} - {taken} = {counted['kutzbach']} (Kutzbach)"
        + (f", in the plane {planar}" if planar is not None else ""),
    ]
    if loose:
        lines.append(
            f"  by rank           {counted['coordinates']} coordinates - rank {counted['rank']} of "
            f"{counted['equations']} equations = {counted['degrees_of_freedom']}"
            + (
                ""
                if counted["rank_at_start"] == counted["rank"]
                else f" (rank {counted['rank_at_start']} at the start)"
            )
        )
    if found["closing_joints"]:
        lines.append(f"  loops closed by   {', '.join(found['closing_joints'])}")
    if counted["redundant"]:
        lines += [f"  redundant         {text}" for text in _grouped(counted["redundant"])]
    lines.append(
        f"Constraints         {_kind(found)}, {'scleronomic' if found['scleronomic'] else 'rheonomic (time enters)'}"
    )
    for row in found["constraints"]:
        if not row["holonomic"]:
            verdict = "integrable: it restricts positions as well" if row["integrable"] else "not integrable"
            lines.append(f"  nonholonomic      {row['name']}: {verdict}")
    return lines


def _kind(found: dict[str, Any]) -> str:
    if all(row["holonomic"] for row in found["constraints"]):
        return "holonomic"
    return "holonomic (those of velocity can be integrated)" if found["holonomic"] else "nonholonomic"


def _grouped(names: list[str]) -> list[str]:
    """Equations by the joint or constraint that they belong to, one line each."""
    found: dict[str, list[str]] = {}
    for name in names:
        owner, _, what = name.partition(": ")
        found.setdefault(owner, []).append(what)
    return [f"{owner}: {'; '.join(what)}" for owner, what in found.items()]


def _mass(matrix: dict[str, Any]) -> list[str]:
    regular = "positive definite" if matrix["positive_definite"] else "singular"
    return [
        f"Mass matrix         {regular}, condition {matrix['condition']:.3g} at the start",
        f"Kinetic energy      T2 {matrix['T2']:.6g} J (squares of the speeds), T1 {matrix['T1']:.6g} J, "
        f"T0 {matrix['T0']:.6g} J",
    ]


def _inertia_forces(terms: dict[str, Any] | None) -> list[str]:
    """The parts of d/dt(∂T/∂q') - ∂T/∂q that motion with time makes; a gyroscopic matrix where it is not zero."""
    if terms is None:
        return []
    complementary = [a + b for a, b in zip(terms["gyroscopic"], terms["unsteady"], strict=True)]
    lines = [
        f"Inertia terms       relative {_vector(terms['relative'])}, transport {_vector(terms['transport'])}, "
        f"Coriolis {_vector(complementary)} at the start"
    ]
    if max(abs(value) for row in terms["gyroscopic_matrix"] for value in row) > 1e-12:
        rows = ", ".join(_vector(row) for row in terms["gyroscopic_matrix"])
        lines.append(f"  gyroscopic matrix [{rows}]: skew, it does no work")
    return lines


def _motions(small: dict[str, Any]) -> list[str]:
    if small["equilibrium"] is None:
        return [
            f"Equilibrium         not looked for: {small['reason']}"
            if "none" not in small["reason"]
            else "Equilibrium         none was found near the start"
        ]
    lines = [f"Equilibrium         at {_vector(small['equilibrium'])}"]
    for mode in small["modes"]:
        if mode["frequency"]:
            lines.append(f"  natural motion    {mode['frequency']:.6g} Hz, damping ratio {mode['damping']:.4g}")
        elif mode["growth"]:
            verb = "grows" if mode["growth"] > 0.0 else "dies away"
            lines.append(f"  natural motion    {verb} without oscillating, by e in {1.0 / abs(mode['growth']):.4g} s")
    if still := sum(not mode["frequency"] and not mode["growth"] for mode in small["modes"]):
        lines.append(f"  neutral           {still} eigenvalues are zero: nothing drives the mechanism back")
    return lines


def _axes(joint: dict[str, Any]) -> str:
    lead = f", {joint['lead']:g} m a turn" if joint["lead"] else ""
    return " ".join(_vector(axis) for axis in joint["axes"]) + lead


def _vector(values: list[float]) -> str:
    return "[" + ", ".join(f"{value + 0.0:.4g}" for value in values) + "]" if values else ""
