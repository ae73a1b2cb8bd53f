"""What `mbd_sim check` says of a mechanism: as data, and in words."""

from __future__ import annotations

from typing import Any

from mbd_sim.mechanism.model import Joint, Part
from mbd_sim.simulation import Simulation


def report(simulation: Simulation) -> dict[str, Any]:
    """All that the report holds, in SI units."""
    mechanism, layout = simulation.mechanism, simulation.model.layout
    energies = simulation.energies
    return {
        "mechanism": mechanism.name,
        "description": mechanism.description,
        "file": mechanism.source.file,
        "parts": [_part(part) for part in mechanism.parts.values()],
        "joints": [_joint(joint) for joint in mechanism.joints.values()],
        "spanning_tree": [f"{joint.inboard} -{joint.name}-> {joint.outboard}" for joint in mechanism.tree_joints()],
        "gross_degrees_of_freedom": 6 * len(mechanism.parts),
        "joint_constraints": sum(6 - len(joint.coordinate_names) for joint in mechanism.joints.values()),
        "driven": list(mechanism.driven_names),
        "degrees_of_freedom": layout.nv,
        "coordinates": list(simulation.coordinate_names),
        "mass": mechanism.mass,
        "gravity": mechanism.gravity.tolist(),
        "start": {"q": simulation.q.tolist(), "u": simulation.u.tolist(), **energies._asdict()},
        "integrator": {
            "method": simulation.model.method.name,
            "order": simulation.model.method.order,
            "step": simulation.step_size,
            "instructions_per_evaluation": simulation.model.kernel.instructions,
        },
        "remarks": [remark for joint in mechanism.joints.values() for remark in _remarks(joint)],
    }


def _part(part: Part) -> dict[str, Any]:
    return {
        "name": part.name,
        "mass": part.mass,
        "center": part.center.tolist(),
        "inertia": part.inertia.tolist(),
        "shapes": [shape.kind for shape in part.shapes],
    }


def _joint(joint: Joint) -> dict[str, Any]:
    return {
        "name": joint.name,
        "type": joint.type,
        "parent": joint.parent,
        "child": joint.child,
        "axes": [axis.tolist() for axis in (joint.axis, joint.second) if axis.any()],
        "lead": joint.lead,
        "position": joint.position.tolist(),
        "velocity": joint.velocity.tolist(),
        "reversed": joint.reversed,
        "coordinates": list(joint.motion_names),
        "drive": [expression.text for expression in joint.drive],
    }


def _remarks(joint: Joint) -> list[str]:
    if joint.limits is not None and joint.limits.stiffness is None:
        return [f"the limits of '{joint.name}' are only described: give limits.stiffness to make them stops"]
    return []


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
            f"{_axes(joint):22s} {_vector(joint['position'])}".rstrip()
            for joint in found["joints"]
        ),
        "",
        f"Degrees of freedom  6·{len(found['parts'])} - {found['joint_constraints']} = {found['degrees_of_freedom']}"
        f"  ({', '.join(found['coordinates']) or 'none'})",
        *(
            f"Driven              {name} = {text}"
            for joint in found["joints"]
            for name, text in zip(joint["coordinates"], joint["drive"], strict=False)
        ),
        f"Total mass          {found['mass']:.6g} kg",
        f"Gravity             {_vector(found['gravity'])} m/s²",
        f"Start energies      kinetic {start['kinetic']:.6g} J, potential {start['potential']:.6g} J, "
        f"total {start['total']:.6g} J",
        f"Integrator          {integrator['method']} (order {integrator['order']}), step {integrator['step']:g} s, "
        f"{integrator['instructions_per_evaluation']} instructions for the accelerations",
        *(f"Remark              {remark}" for remark in found["remarks"]),
    ]
    return "\n".join(lines)


def _axes(joint: dict[str, Any]) -> str:
    lead = f", {joint['lead']:g} m a turn" if joint["lead"] else ""
    return " ".join(_vector(axis) for axis in joint["axes"]) + lead


def _vector(values: list[float]) -> str:
    return "[" + ", ".join(f"{value + 0.0:.4g}" for value in values) + "]" if values else ""
