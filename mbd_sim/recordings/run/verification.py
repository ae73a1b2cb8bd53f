"""Verifies recordings by recomputing them: bit for bit where machine and versions are those of the recording."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

from mbd_sim.recordings.mcap.check import check_file
from mbd_sim.recordings.messages.cdr import RUN_METADATA, RecordedFile
from mbd_sim.recordings.run.comparison import Comparison, Verification
from mbd_sim.recordings.run.metadata import FIRST_EQUATIONS, run_metadata
from mbd_sim.recordings.run.reader import open_recording
from mbd_sim.recordings.run.recomputation import Recomputation

TOLERANCE = 1e-9  # of 1 + the largest number, from one recorded state to the next, for other machines and versions
ENVIRONMENT = ("mbd_sim", "equations", "casadi", "llvmlite", "numpy", "processor")  # on which the bits may depend


def verify(
    path: str | Path, tolerance: float | None = None, progress: Callable[[float], None] | None = None
) -> list[Verification]:
    """Recompute each file of a recording and compare; check all checksums, offsets and indexes of the files.

    :param tolerance: compare to it even where the bits should agree. It is relative to 1 + the largest number of the
        message; each interval between two recorded states then starts from the recorded one.
    :param progress: called with the completed fraction, from 0 to 1.
    :raises ReadingError, RecomputeError, MechanismError: there is nothing to compare.
    """
    files = open_recording(path).files
    results = []
    for number, file in enumerate(files):

        def report(fraction: float, number: int = number) -> None:
            if progress is not None:
                progress((number + fraction) / len(files))

        results.append(_verify_file(file, tolerance, report))
    return results


def _verify_file(file: RecordedFile, tolerance: float | None, progress: Callable[[float], None]) -> Verification:
    recomputation = Recomputation(file)
    simulation = recomputation.simulation
    differences = environment_differences(file.metadata[RUN_METADATA], run_metadata(simulation))
    check = check_file(file.path)
    result = Verification(
        path=file.path,
        mechanism=simulation.mechanism.name,
        method=simulation.model.method_name,
        step=simulation.step_size,
        tolerance=tolerance if tolerance is not None else TOLERANCE if differences else None,
        environment_differences=differences,
        problem=file.problem,
        index_problem=check.index_problem,
        content_problem=check.content_problem,
    )
    Comparison(recomputation, result).run(progress)
    return result


def environment_differences(recorded: Mapping[str, str], present: Mapping[str, str]) -> list[str]:
    """Return how the environment of a recording differs from the present one, as far as bits may depend on it."""
    recorded = {"equations": FIRST_EQUATIONS, **recorded}
    found = [
        f"{key} {recorded[key]}, here {present[key]}"
        for key in ENVIRONMENT
        if recorded.get(key, present[key]) != present[key]
    ]
    platform = recorded.get("platform", present["platform"])
    if _architecture(platform) != _architecture(present["platform"]):
        found.append(f"platform {platform}, here {present['platform']}")
    return found


def _architecture(platform: str) -> str:
    """Return architecture and C library from the value of `platform.platform()`."""
    return "-".join(platform.split("-")[-3:])
