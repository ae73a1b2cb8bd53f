"""The limits on the size of a mechanism file, so that no file can exhaust the machine, and the error beyond them."""

from __future__ import annotations

from mbd_sim.errors import MechanismError, Problem

MAX_BYTES = 1_000_000
MAX_DEPTH = 40
MAX_VALUES = 60_000


def file_error(file: str, line: int, message: str, remedy: str, key: str = "", value: str = "") -> MechanismError:
    """The error for a file that cannot be read any further."""
    return MechanismError([Problem(message, remedy, key=key, value=value, file=file, line=line)])
