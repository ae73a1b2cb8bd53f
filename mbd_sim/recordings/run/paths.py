"""Paths of recordings: one file, or a rosbag2 folder, named after the mechanism and the time."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterable
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from mbd_sim.base.errors import InputError
from mbd_sim.recordings.mcap.rosbag2 import FILE_NAME
from mbd_sim.recordings.mcap.writer import draft_path

FORMATS = ("mcap", "rosbag2")
MAX_NAME_LENGTH = 150  # bytes; file systems allow 255 for a file name
MAX_RECORDINGS_PER_SECOND = 1000  # with the same name


class RecordingError(InputError):
    """A recording that cannot be started, written or repaired."""


@dataclass(frozen=True)
class RecordingPaths:
    """The files of a recording: `NAME.mcap`, `NAME_part2.mcap`; or `NAME/NAME_0.mcap` with rosbag2's metadata.

    `location` is the path for a user to open: the first file, or the folder.
    """

    location: Path
    rosbag2: bool = False

    @property
    def metadata(self) -> Path | None:
        """The path of rosbag2's description of the files, if there is one."""
        return self.location / FILE_NAME if self.rosbag2 else None

    def file(self, number: int) -> Path:
        """Return the path of a file, counted from 0."""
        if self.rosbag2:
            return self.location / f"{self.location.name}_{number}.mcap"
        return self.location if number == 0 else self.location.with_stem(f"{self.location.stem}_part{number + 1}")


def new_recording_paths(folder: Path, name: str, *, rosbag2: bool = False) -> RecordingPaths:
    """Reserve the paths of a new recording, named after `name` and the time, in a folder that is made if missing.

    `~` and `~user` at the start of the folder stand for home folders.
    The folder, or an empty file of a hidden name, is created at once, so that nobody else gets the same name.

    :raises RecordingError: the folder cannot be created or written to.
    """
    stem = f"{file_name(name)}_{datetime.now().astimezone().strftime('%Y%m%d_%H%M%S')}"
    try:
        folder = folder.expanduser()
    except RuntimeError as error:  # there is no such user
        user = folder.parts[0].removeprefix("~")
        raise RecordingError(
            f"cannot record to '{folder}': there is no user '{user}'", "Choose another record_dir."
        ) from error
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for count in range(MAX_RECORDINGS_PER_SECOND):
            location = folder / (stem if not count else f"{stem}_{count}")
            with contextlib.suppress(FileExistsError):
                if rosbag2:
                    location.mkdir()
                else:
                    location = location.with_name(f"{location.name}.mcap")
                    draft_path(location).open("xb").close()
                    if location.exists():
                        draft_path(location).unlink()
                        continue
                return RecordingPaths(location, rosbag2)
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else str(error)
        raise RecordingError(f"cannot record to '{folder}': {reason}", "Choose another record_dir.") from error
    raise RecordingError(
        f"'{folder}' already contains {MAX_RECORDINGS_PER_SECOND} recordings started in this second", "Try again later."
    )


def natural_order(paths: Iterable[Path]) -> list[Path]:
    """Sort paths by their names so that `run_2` comes before `run_10`."""
    return sorted(
        paths,
        key=lambda path: [
            (word.isdigit(), int(word) if word.isdigit() else 0, word) for word in re.split(r"(\d+)", path.name)
        ],
    )


def file_name(name: str) -> str:
    """Return a name as part of a file name: no separators, control characters or leading dots, and not too long.

    >>> file_name("../my/rod")
    '_my_rod'
    """
    plain = re.sub(r"[/\\\x00-\x1f\x7f-\x9f]", "_", name).lstrip(".")
    return plain.encode("utf-8", "replace")[:MAX_NAME_LENGTH].decode("utf-8", "ignore") or "_"
