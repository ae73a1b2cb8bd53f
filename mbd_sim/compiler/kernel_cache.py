"""A cache of compiled kernels on disk, so that each mechanism is compiled once on a machine.

The key of a kernel is the hash of its intermediate code, the processor with its features, and the version of the
compiler. Files are written atomically, by renaming, and have a checksum: several processes may write the same kernel at
once, and a damaged file counts as missing. The environment variable `MBD_SIM_CACHE` names another folder, or disables
the cache if it is empty, 0 or off.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import tempfile
from pathlib import Path

LARGEST = 200e6  # bytes of all kernels together; beyond, the least recently used are removed
_VARIABLE = "MBD_SIM_CACHE"


def folder() -> Path | None:
    """The folder of the cache, or None if it is disabled."""
    if _VARIABLE in os.environ:
        written = os.environ[_VARIABLE]
        return None if written.lower() in ("", "0", "off") else Path(written)
    base = os.environ.get("XDG_CACHE_HOME")
    try:
        return (Path(base) if base else Path.home() / ".cache") / "mbd_sim" / "kernels"
    except RuntimeError:  # there is no home directory
        return None


def key(*contents: str) -> str:
    """The cache key of code that is generated from these texts: their SHA-256 hash."""
    digest = hashlib.sha256()
    for content in contents:
        digest.update(len(content).to_bytes(8, "little"))
        digest.update(content.encode())
    return digest.hexdigest()


def load(name: str) -> bytes | None:
    """The code that was stored under a key, or None."""
    if (directory := folder()) is None:
        return None
    path = directory / name
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
    """Store code under a key; if the folder cannot be written, nothing is stored."""
    if (directory := folder()) is None:
        return
    with contextlib.suppress(OSError):
        directory.mkdir(mode=0o700, parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=directory, delete=False) as file:
            file.write(hashlib.sha256(code).digest() + code)
        Path(file.name).replace(directory / name)
        _prune(directory)


def _prune(directory: Path) -> None:
    """Remove the least recently used kernels until all together are at most `LARGEST` bytes."""
    found = []
    for path in directory.iterdir():
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
