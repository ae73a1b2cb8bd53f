"""Where recordings are put: one file, or a folder as rosbag2 makes them, with a name from mechanism and time."""

from __future__ import annotations

import contextlib
import re
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from mbd_sim.errors import MbdSimError

FORMATS = ("mcap", "rosbag2")
LONGEST = 150  # bytes of a name; systems take 255 for a file's


class RecordingError(MbdSimError):
    """A recording that cannot be started."""


@dataclass(frozen=True)
class Series:
    """The files of one recording: `NAME.mcap`, `NAME_part2.mcap`; or `NAME/NAME_0.mcap`, with rosbag2's metadata."""

    place: Path
    rosbag2: bool = False

    @property
    def metadata(self) -> Path | None:
        """Where rosbag2's description of the files belongs, where there is one."""
        return self.place / "metadata.yaml" if self.rosbag2 else None

    def file(self, number: int) -> Path:
        """The path of a file, counted from 0."""
        if self.rosbag2:
            return self.place / f"{self.place.name}_{number}.mcap"
        return self.place if number == 0 else self.place.with_stem(f"{self.place.stem}_part{number + 1}")


def new_series(folder: Path, name: str, *, rosbag2: bool = False) -> Series:
    """A recording that does not exist yet, from a name and the time, in a folder that is made where it is missing.

    It is taken at once, so that nobody else gets the same.

    :raises RecordingError: the folder cannot be made or written.
    """
    stem = f"{file_name(name)}_{datetime.now().astimezone().strftime('%Y%m%d_%H%M%S')}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for count in range(1000):
            place = folder / (stem if not count else f"{stem}_{count}")
            with contextlib.suppress(FileExistsError):
                if rosbag2:
                    place.mkdir()
                else:
                    place = place.with_name(f"{place.name}.mcap")
                    place.open("xb").close()
                return Series(place, rosbag2)
    except (OSError, ValueError) as error:
        why = error.strerror if isinstance(error, OSError) else str(error)
        raise RecordingError(f"cannot record to '{folder}': {why}. Choose another record_dir.") from error
    raise RecordingError(f"'{folder}' already holds a thousand recordings of this second.")


def new_file(folder: Path, name: str) -> Path:
    """The path of a recording in one file; see `new_series`."""
    return new_series(folder, name).place


def file_name(name: str) -> str:
    """A name as a part of a file's: no separators, control characters or leading dots, and not too long.

    >>> file_name("../my/rod")
    '_my_rod'
    """
    plain = re.sub(r"[/\\\x00-\x1f\x7f-\x9f]", "_", name).lstrip(".")
    return plain.encode("utf-8", "replace")[:LONGEST].decode("utf-8", "ignore") or "_"
