"""A run to work with: a recording, or a mechanism that is run and recorded first."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from mbd_sim.base.errors import InputError, nearest
from mbd_sim.cli.shared.command import SECONDS, ProgressBar, temporary_file
from mbd_sim.cli.shared.common import (
    ANY_RECORDING,
    DURATION,
    MCAP_OR_BAG,
    add_method_and_step,
    positive_in,
    print_notes,
)
from mbd_sim.cli.shared.setup_options import add_set, add_start, build_simulation
from mbd_sim.files.text.library import SUFFIXES, shipped
from mbd_sim.recordings.run.reader import open_recording
from mbd_sim.recordings.run.run_recorder import RunRecorder
from mbd_sim.recordings.views.table import RunTable, read_table
from mbd_sim.simulation.run.arguments import steps_in
from mbd_sim.simulation.run.simulation import BaseSimulation

OR_MECHANISM = "or a mechanism file, a URDF, MJCF or SDF, or the name of a shipped mechanism, which is run first"
RECORDING_SUFFIXES = (".mcap", ".db3", ".zstd")


def add_run(
    parser: argparse.ArgumentParser, *, several: bool = False, changes: bool = True, recomputed: bool = False
) -> None:
    """Declare the run, and the options for a mechanism.

    :param several: accept more than one run.
    :param changes: declare `--set`, `--method` and `--step` too.
    :param recomputed: the run must contain its mechanism, which `.db3` files lack.
    """
    kinds = f"{MCAP_OR_BAG if recomputed else ANY_RECORDING}; {OR_MECHANISM}"
    if several:
        parser.add_argument("recordings", metavar="RUN", nargs="+", help=f"{kinds}; one or more")
    else:
        parser.add_argument("recording", metavar="RUN", help=kinds)
    group = parser.add_argument_group("options for a mechanism that is run first")
    group.add_argument("--time", type=positive_in("s"), metavar="S", help=f"seconds to simulate (default {DURATION:g})")
    if changes:
        add_method_and_step(group, "from the file")
        add_set(group)
    add_start(group)


@contextmanager
def recorded_run(
    run: str,
    options: argparse.Namespace,
    *,
    rate: float | None = None,
    reactions: bool = False,
    contact_forces: bool = False,
    with_changes: bool = True,
) -> Iterator[Path]:
    """The path of a recording, or of the temporary recording of a mechanism's run.

    :param rate: states per second that are recorded, where the mechanism's step allows that many.
    :param with_changes: whether `--set`, `--method` and `--step` are for the run.
    :raises InputError: options for a mechanism are given with a recording, or there is no such run.
    :raises DivergedError: the state became infinite.
    """
    if is_recording(run):
        _refuse_setup(run, options, with_changes)
        yield Path(run)
        return
    with temporary_file(f"{Path(run).stem}.mcap") as path:
        options.mechanism = run
        simulation = build_simulation(options, with_changes=with_changes)
        rate = min(rate, 1.0 / simulation.step_size) if rate else None
        with RunRecorder(simulation, path, rate=rate, reactions=reactions, contact_forces=contact_forces):
            run_for(simulation, options.time or DURATION, options.quiet)
        yield path


def run_for(simulation: BaseSimulation, duration: float, quiet: bool) -> None:
    """Run for a duration in s, with a progress bar.

    :raises InputError: the duration is less than a step.
    """
    steps_in(duration, simulation.step_size)
    with ProgressBar(simulation.mechanism.name, quiet, total=duration, amount=SECONDS) as progress:
        simulation.run(until=duration, progress=progress.show)


def is_recording(run: str) -> bool:
    """Whether a run is named by its recording; otherwise it is a mechanism.

    :raises InputError: there is neither.
    """
    path = Path(run)
    if path.suffix in RECORDING_SUFFIXES or (path.is_file() and path.suffix not in SUFFIXES):
        return True
    if path.suffix in SUFFIXES:
        return False
    if path.is_dir() and (run not in shipped() or _holds_recording(path)):
        return True
    if run in shipped():
        return False
    if path.parent != Path():
        raise InputError(f"{run}: there is no such file or folder", "Check the path.")
    remedy = f"{nearest(run, shipped())} Or give the path of a recording or of a .yaml, .urdf, .xml or .sdf file."
    raise InputError(f"{run}: there is neither a recording nor a shipped mechanism of this name", remedy)


def _holds_recording(folder: Path) -> bool:
    return any(file.name == "metadata.yaml" or file.suffix in RECORDING_SUFFIXES for file in sorted(folder.iterdir()))


def _refuse_setup(run: str, options: argparse.Namespace, with_changes: bool) -> None:
    names: Sequence[str] = ("time", "start", "effort", *(("changes", "method", "step") if with_changes else ()))
    given = ["--set" if name == "changes" else f"--{name}" for name in names if getattr(options, name, None)]
    if given:
        raise InputError(
            f"{run} is a recording: {', '.join(given)} would have no effect",
            "Leave it out, or use rerun-with to recompute the run with a change." if with_changes else "Leave it out.",
        )


def read_run_table(path: Path, quiet: bool, name: str = "") -> RunTable:
    """Read a recording's states as a table, with a progress bar; print the notes about them.

    :param name: of the run, where the recording is a temporary file.
    """
    recording = open_recording(path)
    with ProgressBar("read", quiet) as progress:
        table = read_table(recording, progress.show)
    print_notes(table.notes)
    return replace(table, path=Path(name)) if name else table
