"""An MJCF as the source of a mechanism: its bodies, joints, equalities, tendons and actuators.

MuJoCo's compiler resolves the file; what it means is read from the compiled model. Names are those of the MJCF, and so
are the coordinates: a hinge is at its `ref` where the file places its body.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mbd_sim.mechanism.names import accepted_names
from mbd_sim.mechanism.source import Source
from mbd_sim.mechanism_file.file_limits import file_error
from mbd_sim.mjcf.compiled_model import CompiledModel
from mbd_sim.mjcf.left_out import note_left_out
from mbd_sim.mjcf.model_actuators import Actuators
from mbd_sim.mjcf.model_equalities import add_equalities
from mbd_sim.mjcf.model_forces import add_armature, add_gravity_compensation, add_joint_forces
from mbd_sim.mjcf.model_parts import ModelParts
from mbd_sim.mjcf.model_tendons import add_tendon, tendon_of
from mbd_sim.urdf.value_reader import rows

GRAVITY = [0.0, 0.0, -9.81]


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
    loops = len(parts.sections["joints"])
    add_equalities(parts, tendons)
    if len(parts.sections["joints"]) > loops or "constraints" in parts.sections:
        _let_assembly_move(parts.sections["joints"])
    add_armature(parts, tendons, Actuators(parts, tendons))
    note_left_out(model)
    return _source(model, parts)


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
