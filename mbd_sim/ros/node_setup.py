"""What the parameters of the node ask for."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mbd_sim.errors import nearest
from mbd_sim.load import load_mechanism
from mbd_sim.recording.recorder import Recorder
from mbd_sim.recording.recording_paths import FORMATS, new_recording_paths
from mbd_sim.recording.run_metadata import run_metadata
from mbd_sim.ros.node_parameters import Parameters
from mbd_sim.ros.node_recordings import Limits, Recordings
from mbd_sim.ros.publishing_thread import Outputs, Wanted
from mbd_sim.ros.stepping_thread import Runner
from mbd_sim.ros.wrench_buffer import EVERY, Loadable, loadable
from mbd_sim.simulation.simulation import Simulation
from mbd_sim.viewer import Viewer, ViewerError


def build(parameters: Parameters) -> tuple[Simulation, Loadable]:
    """The simulation, and what of it takes wrenches.

    :raises MechanismError, ValueError: a parameter does not fit the mechanism, or its file is wrong.
    """
    mechanism = load_mechanism(parameters["mechanism"])
    loads = loadable(mechanism, parameters.listed("wrenches"))
    simulation = Simulation(
        mechanism,
        method=parameters["method"] or None,
        step=parameters["step"] or None,
        wrenches=tuple(dict.fromkeys(part for part, _ in loads)),
        live=parameters.listed("live"),
    )
    return simulation, loads


def wanted(parameters: Parameters, part_names: tuple[str, ...]) -> Wanted:
    """What is published besides joints and energies.

    :raises ValueError: `part_poses` names a part that does not exist.
    """
    given = parameters.listed("part_poses")
    for name in given:
        if name not in (*part_names, EVERY):
            raise ValueError(f"part_poses: there is no part '{name}'. {nearest(name, part_names)}")
    return Wanted(
        reactions=parameters["joint_reactions"],
        violation=parameters["constraint_violation"],
        poses=part_names if EVERY in given else tuple(given),
        tf=parameters["tf"],
        marker_rate=parameters["marker_rate"],
        frame_prefix=parameters["frame_prefix"],
    )


def recordings(parameters: Parameters, runner: Runner, outputs: Outputs, log: Any) -> Recordings:
    """What records, now or later.

    :raises ValueError: `record_format` is unknown.
    """
    simulation = runner.simulation
    mechanism, form = simulation.mechanism, parameters["record_format"]
    if form not in FORMATS:
        raise ValueError(f"record_format: there is no '{form}'. {nearest(form, FORMATS)}")

    def open_recorder() -> Recorder:
        folder = Path(parameters["record_dir"]).expanduser()
        paths = new_recording_paths(folder, mechanism.name, rosbag2=form == "rosbag2")
        return Recorder(paths, outputs.topics(), mechanism.source.text)

    return Recordings(
        open_recorder,
        lambda moment: run_metadata(simulation, moment, parameters.values),
        runner.mark,
        lambda failure: log.error(f"{failure}. The simulation goes on."),
        limits(parameters),
    )


def limits(parameters: Parameters) -> Limits:
    """Where a recording goes on in another file."""
    return Limits(1e6 * parameters["record_split_size"], parameters["record_split_duration"])


def viewer(parameters: Parameters, simulation: Simulation, log: Any) -> Viewer | None:
    """The Rerun viewer; None where it is not wanted or cannot be, which is logged."""
    if not parameters["rerun"]:
        return None
    try:
        found = Viewer(
            simulation.model,
            parameters["rerun"],
            rate=parameters["rerun_rate"],
            traces=parameters.listed("rerun_traces") or None,
            trace_time=parameters["rerun_trace_time"],
            reactions=parameters["joint_reactions"],
        )
    except (ViewerError, ValueError) as error:
        log.error(f"{error} The run is not shown.")
        return None
    log.info(f"showing in Rerun: {found.address}")
    return found
