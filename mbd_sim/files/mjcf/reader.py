"""An MJCF as the source of a mechanism: its bodies, joints, equalities, tendons and actuators.

MuJoCo's compiler resolves the file; what it means is read from the compiled model. Names are those of the MJCF, and so
are the coordinates: a hinge is at its `ref` where the file places its body. What the model has that is not simulated
is listed, with what it would do.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from mbd_sim.files.mjcf.compiled_model import CompiledModel
from mbd_sim.files.mjcf.contacts import add_contacts
from mbd_sim.files.mjcf.couplings import add_equalities, add_tendon, tendon_of
from mbd_sim.files.mjcf.forces import Actuators, add_armature, add_gravity_compensation, add_joint_forces
from mbd_sim.files.mjcf.parts import BALL, FREE, ModelParts
from mbd_sim.files.mjcf.sensors import add_sensors
from mbd_sim.files.text.library import file_error
from mbd_sim.files.text.xml import rows
from mbd_sim.mechanism.values.names import accepted_names
from mbd_sim.mechanism.values.source import Source

TIME_STEP = 0.002  # s, unless the model gives another one
GRAVITY = [0.0, 0.0, -9.81]
START = "start"  # the name of a keyframe, which exported files have: the start values of the joints
UNUSED = {
    "flex": "flexes, which have masses but no stiffness here",
    "skin": "skins, which are only seen",
    "camera": "cameras",
    "light": "lights",
}


def note_left_out(model: CompiledModel) -> None:
    """List what is not simulated, by element and line."""
    m = model.m
    for kind, sentence in UNUSED.items():
        for index in range(model.count(kind)):
            model.leave_out(sentence, kind, index)
    for geom in range(m.ngeom):
        if np.any(m.geom_fluid[geom][:1]) and (m.opt.density or m.opt.viscosity):
            model.leave_out("forces of the medium on ellipsoids", "geom", geom)
    for body in range(1, m.nbody):
        if m.body_mocapid[body] >= 0:
            model.leave_out("mocap bodies, which stay where they are", "body", body)
        if m.body_plugin[body] >= 0:
            model.leave_out("plugins of bodies", "body", body)
    _note_options(model)


def _note_options(model: CompiledModel) -> None:
    option = model.m.opt
    if option.timestep != TIME_STEP:
        kind = "time step, in place of which integrator.step has its default"
        model.reading.leave_out(kind, f"{option.timestep:g} s")
    for name in ("density", "viscosity"):
        if value := getattr(option, name):
            model.reading.leave_out("forces of the medium", f"{name} {value:g}")
    if np.any(option.wind):
        model.reading.leave_out("forces of the medium", f"wind {option.wind}")


def mjcf_source(text: str, file: str) -> Source:
    """An MJCF as the source of a mechanism file, with the origins of its values.

    Its `notes` list everything that was left out.

    :raises MechanismError: MuJoCo's compiler is missing or refuses the model, or the model has no body.
    """
    model = CompiledModel(text, file)
    if model.m.nbody < 2:
        raise file_error(file, 1, "has no <body>", "Add the bodies of the model.", key="worldbody")
    parts = ModelParts(model)
    tendons = [tendon_of(parts, index) for index in range(model.m.ntendon)]
    add_joint_forces(parts)
    add_gravity_compensation(parts)
    for tendon in tendons:
        add_tendon(parts, tendon)
    _add_start(parts)
    loops = len(parts.sections["joints"])
    add_equalities(parts, tendons)
    if len(parts.sections["joints"]) > loops or "constraints" in parts.sections:
        _let_assembly_move(parts.sections["joints"])
    add_armature(parts, tendons, Actuators(parts, tendons))
    add_contacts(parts)
    add_sensors(parts)
    note_left_out(model)
    return _source(model, parts)


def _add_start(parts: ModelParts) -> None:
    """Take the positions and velocities of the keyframe `START`; note the others, and what else it has."""
    model, m = parts.model, parts.model.m
    for index in range(m.nkey):
        if model.name("key", index) != START:
            model.leave_out(f"keyframes: the start is the pose of the file, or the keyframe '{START}'", "key", index)
            continue
        if np.any(m.key_ctrl[index]) or np.any(m.key_act[index]):
            model.leave_out("controls and activations of keyframes", "key", index)
        for joint in range(m.njnt):
            position, speed = int(m.jnt_qposadr[joint]), int(m.jnt_dofadr[joint])
            record = parts.sections["joints"][parts.joints[joint]]
            record |= _start_values(int(m.jnt_type[joint]), m.key_qpos[index][position:], m.key_qvel[index][speed:])


def _start_values(kind: int, qpos: Any, qvel: Any) -> dict[str, Any]:
    """The start values of a joint, from those of the keyframe that begin with its own."""
    values: dict[str, Any]
    speeds: dict[str, Any]
    if kind == FREE:
        values = {"position": rows(qpos[:3]), "orientation": {"quaternion": rows(qpos[3:7])}}
        speeds = {"velocity": rows(qvel[:3]), "angular_velocity": rows(qvel[3:6])}
    elif kind == BALL:
        values, speeds = {"orientation": {"quaternion": rows(qpos[:4])}}, {"angular_velocity": rows(qvel[:3])}
    else:
        values, speeds = {"position": float(qpos[0])}, {"velocity": float(qvel[0])}
    return values | {key: value for key, value in speeds.items() if np.any(value)}


def _let_assembly_move(joints: dict[str, Any]) -> None:
    """Make the reference positions a guess: constraints may not hold there."""
    for record in joints.values():
        if "position" in record:
            record["guess"] = True


def _source(model: CompiledModel, parts: ModelParts) -> Source:
    name = model.spec.modelname or "model"
    gravity = [0.0, 0.0, 0.0] if model.disabled("GRAVITY") else rows(model.m.opt.gravity)
    content: dict[str, Any] = {"mechanism": accepted_names([name], "model")[name]}
    content |= {} if gravity == GRAVITY else {"gravity": gravity}
    content |= {key: entries for key, entries in parts.sections.items() if entries}
    source = Source(content, file=model.file, origins=parts.origins, format="MJCF")
    source.notes = model.reading.notes
    source.comments = (f"From {Path(model.file).name}.", *source.notes)
    source.other_files = model.other_files
    return source
