"""`mbd_sim recover`: repair recordings truncated by a killed process or a full disk."""

from __future__ import annotations

import argparse
from pathlib import Path

from mbd_sim.base.errors import counted
from mbd_sim.cli.shared.common import MCAP_OR_BAG, add_recordings

HELP = "repair recordings with a truncated end or a damaged index"
DESCRIPTION = (
    "Repair recordings: remove everything after the last complete, undamaged record of each file, and write the "
    "summary and the indexes that MCAP tools need. If more than an incomplete end is removed, the original is kept as "
    "FILE.damaged."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_recordings(parser, MCAP_OR_BAG)


def execute(options: argparse.Namespace) -> int:
    """Recover the recordings and print the contents of each.

    :raises RecordingError: one cannot be read or written, or is not a recording.
    """
    from mbd_sim.recordings.run.paths import RecordingError
    from mbd_sim.recordings.run.recovery import recover, recover_bag

    for path in options.recordings:
        try:
            for file, counts in recover_bag(path) if path.is_dir() else [(path, recover(path))]:
                print(_report(file, counts))
        except FileNotFoundError as error:
            raise RecordingError(f"{path}: there is no such file. Check the path.") from error
        except (OSError, ValueError, LookupError) as error:
            raise RecordingError(f"{path}: {error}") from error
    return 0


def _report(path: Path, counts: dict[str, int] | None) -> str:
    from mbd_sim.recordings.run.recovery import damaged_original

    if counts is None:
        return f"{path}: is complete, nothing to repair"
    by_topic = ", ".join(f"{count} of {topic}" for topic, count in counts.items() if count)
    original = damaged_original(path)
    kept = f"; the damaged file is kept as {original}" if original.exists() else ""
    return f"{path}: {counted(sum(counts.values()), 'message')} kept{': ' if by_topic else ''}{by_topic}{kept}"
