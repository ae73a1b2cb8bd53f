"""What a compiled MJCF has and is not simulated, with what it would do."""

from __future__ import annotations

import numpy as np

from mbd_sim.mjcf.compiled_model import CompiledModel

TIME_STEP = 0.002  # s, unless the model gives another one
UNUSED = {
    "sensor": "sensors, which are not read",
    "key": "keyframes: the start is the pose of the file",
    "flex": "flexes, which have masses but no stiffness here",
    "skin": "skins, which are only seen",
    "pair": "contacts of pairs of geoms",
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
        if m.geom_bodyid[geom] == 0:
            model.leave_out("geoms of the world, which are not drawn", "geom", geom)
        if (m.geom_contype[geom] or m.geom_conaffinity[geom]) and not model.disabled("CONTACT"):
            model.leave_out("contacts of geoms, through which other bodies pass", "geom", geom)
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
