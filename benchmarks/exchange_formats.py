"""Writes every shipped mechanism as MJCF and SDF and lets MuJoCo, Drake and our own readers read the files.

python -m benchmarks.exchange_formats

With files as arguments, reads these MJCF models instead, and compares their accelerations with MuJoCo's at a random
state, without contacts, limits, friction and the medium, which are not imported or are soft in MuJoCo:

python -m benchmarks.exchange_formats models/*.xml

Needs MuJoCo; Drake is left out if it is not installed.
"""

from __future__ import annotations

import argparse
import importlib.util
from collections.abc import Callable
from functools import partial
from pathlib import Path

import mujoco
import numpy as np

from mbd_sim import MbdSimError, Simulation, load_mechanism
from mbd_sim.files.load import parse_mechanism
from mbd_sim.files.mjcf.writer import to_mjcf
from mbd_sim.files.sdf.writer import to_sdf
from mbd_sim.files.text.library import shipped
from mbd_sim.mechanism.mechanism import Mechanism

REACH = 0.5  # m, rad, m/s and rad/s from the start


def main() -> None:
    """Print a line for each mechanism or model."""
    parser = argparse.ArgumentParser(description="Exchange mechanisms with MuJoCo and Drake.")
    parser.add_argument("models", type=Path, nargs="*", metavar="MODEL", help="MJCF files to compare with MuJoCo")
    options = parser.parse_args()
    mujoco.set_mju_user_warning(lambda message: None)  # otherwise it writes a log file
    if options.models:
        for path in options.models:
            print(f"{path.name:40} {_result(partial(compared, path))}")
        return
    for name in shipped():
        mechanism = load_mechanism(name)
        results = {reader: _result(partial(read, mechanism)) for reader, read in READERS.items()}
        print(f"{name:30} " + "  ".join(f"{reader}: {result}" for reader, result in results.items()))


def _result(check: Callable[[], str]) -> str:
    try:
        return check()
    except (MbdSimError, ValueError, RuntimeError) as error:
        return f"refused: {str(error).splitlines()[0][:150]}"


def compared(path: Path) -> str:
    """The largest difference of accelerations, relative to the largest acceleration."""
    model = mujoco.MjModel.from_xml_path(str(path))
    sim = Simulation(load_mechanism(path))
    if model.nq != len(sim.q) or model.neq:
        return f"not compared: {model.nq} coordinates and {model.neq} equalities in MuJoCo, {len(sim.q)} here"
    model.opt.density = model.opt.viscosity = 0.0
    data, rng = mujoco.MjData(model), np.random.default_rng(1)
    mujoco.mj_integratePos(model, data.qpos, rng.uniform(-REACH, REACH, model.nv), 1.0)
    data.qvel[:] = rng.uniform(-REACH, REACH, model.nv)
    mujoco.mj_forward(model, data)
    y = sim.state
    y[sim.model.q_range], y[sim.model.u_range] = data.qpos, data.qvel
    sim.restore(y, 0)
    exact = data.qacc_smooth  # without friction, limits and contacts
    friction = [joint.name for joint in sim.mechanism.joints.values() if joint.friction]
    remark = f", friction in {len(friction)} joints" if friction else ""
    return f"{np.max(np.abs(sim.u_rates - exact)) / np.max(np.abs(exact)):.1e}{remark}"


def _by_mujoco(mechanism: Mechanism) -> str:
    return f"{mujoco.MjModel.from_xml_string(to_mjcf(mechanism).text).nv} speeds"


def _by_own_reader(mechanism: Mechanism) -> str:
    parse_mechanism(to_mjcf(mechanism).text)
    return f"{len(parse_mechanism(to_sdf(mechanism).text).coordinate_names)} speeds"


def _by_drake(mechanism: Mechanism) -> str:
    from pydrake.multibody.parsing import Parser
    from pydrake.multibody.plant import MultibodyPlant

    if mechanism.closing:
        return "not read, because it has loops"
    plant = MultibodyPlant(0.0)
    Parser(plant).AddModelsFromString(to_sdf(mechanism).text, "sdf")
    plant.Finalize()
    return f"{plant.num_velocities()} speeds"


READERS: dict[str, Callable[[Mechanism], str]] = {"MuJoCo": _by_mujoco, "mbd_sim": _by_own_reader}
if importlib.util.find_spec("pydrake"):
    READERS["Drake"] = _by_drake


if __name__ == "__main__":
    main()
