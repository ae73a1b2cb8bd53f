"""Compiled kernels on disk, so that a mechanism is compiled once for a machine and found again by every process.

A kernel is kept under the hash of its intermediate code, the processor with its features, and the compiler's
version. Files appear whole, by renaming, and carry a checksum: processes that write the same kernel at once do no
harm, and a damaged file counts as missing. `MBD_SIM_CACHE` names another folder, or is empty, 0 or off for none.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import tempfile
from pathlib import Path

LARGEST = 200e6  # bytes of all kernels together; beyond, those not used for longest go
_VARIABLE = "MBD_SIM_CACHE"


def folder() -> Path | None:
    """Where kernels are kept, or None where none are."""
    if _VARIABLE in os.environ:
        written = os.environ[_VARIABLE]
        return None if written.lower() in ("", "0", "off") else Path(written)
    base = os.environ.get("XDG_CACHE_HOME")
    try:
        return (Path(base) if base else Path.home() / ".cache") / "mbd_sim" / "kernels"
    except RuntimeError:  # nobody's home
        return None


def key(*contents: str) -> str:
    """A name for what is made from these texts."""
    digest = hashlib.sha256()
    for content in contents:
        digest.update(len(content).to_bytes(8, "little"))
        digest.update(content.encode())
    return digest.hexdigest()


def load(name: str) -> bytes | None:
    """What is kept under a name, or None."""
    if (place := folder()) is None:
        return None
    path = place / name
    try:
        content = path.read_bytes()
    except OSError:
        return None
    checksum, code = content[:32], content[32:]
    if hashlib.sha256(code).digest() != checksum:
        return None
    with contextlib.suppress(OSError):
        os.utime(path)
    return code


def store(name: str, code: bytes) -> None:
    """Keep something under a name; where that cannot be done, nothing is kept."""
    if (place := folder()) is None:
        return
    with contextlib.suppress(OSError):
        place.mkdir(mode=0o700, parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=place, delete=False) as file:
            file.write(hashlib.sha256(code).digest() + code)
        Path(file.name).replace(place / name)
        _prune(place)


def _prune(place: Path) -> None:
    """Remove the kernels not used for longest until all together are small enough."""
    found = []
    for path in place.iterdir():
        with contextlib.suppress(OSError):
            state = path.stat()
            found.append((state.st_mtime, state.st_size, path))
    total = sum(size for _, size, _ in found)
    for _, size, path in sorted(found):
        if total <= LARGEST:
            break
        with contextlib.suppress(OSError):
            path.unlink()
            total -= size
