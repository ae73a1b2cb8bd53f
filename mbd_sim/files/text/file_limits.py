"""Reads the text of a file, within limits so that no file can exhaust the machine, and the error beyond them."""

from __future__ import annotations

import hashlib
from pathlib import Path

from mbd_sim.base.errors import MechanismError, Problem

MAX_BYTES = 1_000_000
MAX_DEPTH = 40
MAX_VALUES = 60_000


def file_error(file: str, line: int, message: str, remedy: str, key: str = "", value: str = "") -> MechanismError:
    """The error for a file that cannot be read any further."""
    return MechanismError([Problem(message, remedy, key=key, value=value, file=file, line=line)])


def too_deep(file: str, line: int) -> MechanismError:
    """The error for a value that is nested deeper than `MAX_DEPTH`."""
    return file_error(file, line, f"nested deeper than {MAX_DEPTH} levels", "Flatten the file.")


def read_text(path: Path) -> str:
    """The text of a file.

    :raises MechanismError: the file cannot be read, is too large, or is not UTF-8.
    """
    try:
        with path.open("rb") as stream:
            raw = stream.read(MAX_BYTES + 1)
        if len(raw) > MAX_BYTES:
            raise file_error(
                str(path), 1, f"the file is larger than {MAX_BYTES} bytes", "A mechanism file normally has a few kB."
            )
        text = raw.decode("utf-8")
    except UnicodeDecodeError as error:
        line = raw.count(b"\n", 0, error.start) + 1
        raise file_error(str(path), line, f"not UTF-8 text: {error.reason}", "Save the file as UTF-8.") from error
    except OSError as error:
        raise file_error(str(path), 0, f"cannot read the file: {error.strerror}", "Check its permissions.") from error
    return text


def digest_of_file(path: Path) -> str:
    """A digest of the content of a file, which is that of its text; empty if it cannot be read."""
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError:
        return ""


def digest_of(text: str) -> str:
    """A digest of the text of a file, by which it is found to have changed."""
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()
