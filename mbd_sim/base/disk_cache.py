"""A cache on disk of compiled kernels and of mechanism files, so that each is compiled or read once on a machine.

An entry is found by the hash of everything that it was made from, its key. What is `cached` as Python objects also
depends on the versions of this package and of what it is built with. Files are written atomically, by renaming,
and have a checksum: several processes may write the same entry at once, and a damaged file counts as missing. The
environment variable `MBD_SIM_CACHE` names another folder, or disables the cache if it is empty, 0 or off.

What is loaded is executed. Therefore a folder or file that another user than the administrator owns or may write is not
used, as ssh does with its keys. A warning says so once, and also once that nothing can be stored.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import importlib.util
import os
import pickle
import stat
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeVar

import numpy as np

from mbd_sim.base.operating_system import BINARY, HAS_FOLDER_DESCRIPTORS, NOT_THROUGH_LINKS, is_safe

LARGEST = 200e6  # bytes of all entries together; beyond, the least recently used are removed
# Of `LARGEST`. To look at thousands of entries takes as long as to compile a small mechanism. So it is done once for so
# many bytes on average, after an entry with a probability in proportion to its size: the cache may exceed its size by
# some SMALL.
SMALL = 5e-3
_VARIABLE = "MBD_SIM_CACHE"


def folder() -> Path | None:
    """The folder of the cache, or None if it is disabled."""
    if _VARIABLE in os.environ:
        written = os.environ[_VARIABLE]
        return None if written.lower() in ("", "0", "off") else Path(written)
    if sys.platform != "linux":
        import platformdirs

        return Path(platformdirs.user_cache_dir(), "mbd_sim", "kernels")
    base = os.environ.get("XDG_CACHE_HOME", "")
    try:
        # The specification of XDG demands that a relative path is ignored.
        return (Path(base) if Path(base).is_absolute() else Path.home() / ".cache") / "mbd_sim" / "kernels"
    except RuntimeError:  # there is no home directory
        return None


def key(*contents: str) -> str:
    """The key of what is made from these texts: their SHA-256 hash."""
    digest = hashlib.sha256()
    for content in contents:
        digest.update(len(content).to_bytes(8, "little"))
        digest.update(content.encode("utf-8", "surrogatepass"))
    return digest.hexdigest()


def load(name: str) -> bytes | None:
    """What was stored under a key, or None."""
    if (directory := folder()) is None:
        return None
    with contextlib.suppress(OSError), _opened(directory) as opened:
        # No link is followed, and what is checked is what is read: the open file.
        path = name if opened is not None else directory / name
        file = os.open(path, os.O_RDONLY | BINARY | NOT_THROUGH_LINKS, dir_fd=opened)
        with os.fdopen(file, "rb") as stream:
            if not stat.S_ISREG(os.fstat(file).st_mode) or not _may_be_used(os.fstat(file), directory / name):
                return None
            content = stream.read()
            with contextlib.suppress(OSError):
                os.utime(file if os.utime in os.supports_fd else path)
        checksum, content = content[:32], content[32:]
        return content if hashlib.sha256(content).digest() == checksum else None
    return None


def store(name: str, content: bytes) -> None:
    """Store content under a key; if the folder cannot be written or is not safe, nothing is stored."""
    if (directory := folder()) is None:
        return
    try:
        _make(directory)
        with _opened(directory), tempfile.NamedTemporaryFile(dir=directory, delete=False) as file:
            file.write((checksum := hashlib.sha256(content).digest()) + content)
        Path(file.name).replace(directory / name)
        if int.from_bytes(checksum[:4], "big") < 2.0**32 * len(content) / (LARGEST * SMALL):
            _prune(directory)
    except _UnsafeError:
        pass
    except OSError as error:
        _say_unwritable(directory, error.strerror or str(error))


class _UnsafeError(PermissionError):
    """Somebody else may change the folder; a warning has said so."""


def _make(directory: Path) -> None:
    """Make the folder, but none within folders that do not let us use it: that would lock out their owner.

    :raises OSError: that is not possible.
    """
    existing = next(above for above in (directory, *directory.absolute().parents) if above.exists())
    if existing != directory:
        _check_folders(existing.resolve(), directory)
        directory.mkdir(mode=0o700, parents=True, exist_ok=True)


@contextlib.contextmanager
def _opened(directory: Path) -> Iterator[int | None]:
    """The descriptor of the folder, if it and all folders above it can only be changed by us and the administrator.

    It is None where the system has no descriptors of folders.

    :raises OSError: it cannot be opened, or somebody else may change it.
    """
    path = directory.resolve(strict=True)  # a link in a safe folder is as safe as its target
    _check_folders(path.parent, directory)
    if not HAS_FOLDER_DESCRIPTORS:
        yield None
        return
    opened = os.open(path, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW)
    try:
        if not _may_be_used(os.fstat(opened), directory):
            raise _UnsafeError(str(directory))
        yield opened
    finally:
        os.close(opened)


def _check_folders(path: Path, used: Path) -> None:
    """:raises OSError: somebody else may change the folder or one above it, see `is_safe`."""
    for folder in (path, *path.parents):
        if not is_safe(folder.stat(), sticky=True):
            _refuse(folder, used)
            raise _UnsafeError(str(folder))


def _may_be_used(state: os.stat_result, path: Path) -> bool:
    """Whether nobody else can change a file or folder, see `is_safe`; if not, a warning says so once."""
    safe = is_safe(state)
    if not safe:
        _refuse(path, path)
    return safe


@functools.cache
def _refuse(path: Path, used: Path) -> None:
    """Warn once for each path."""
    warnings.warn(
        f"the cache '{used}' is not used: another user owns '{path}' or can write to it. "
        f"Run: chmod go-w '{path}', or set {_VARIABLE} to a folder of yours.",
        RuntimeWarning,
        stacklevel=2,
    )


@functools.cache
def _say_unwritable(directory: Path, reason: str) -> None:
    """Warn once for each folder."""
    warnings.warn(
        f"nothing can be stored in the cache '{directory}' ({reason}): mechanisms are compiled anew each time. "
        f"Set {_VARIABLE} to a folder of yours, or to 'off'.",
        RuntimeWarning,
        stacklevel=2,
    )


def _prune(directory: Path) -> None:
    """Remove the least recently used entries until all together are at most `LARGEST` bytes."""
    found = []
    with os.scandir(directory) as entries:
        for entry in entries:
            with contextlib.suppress(OSError):
                state = entry.stat()
                found.append((state.st_mtime, state.st_size, entry.path))
    total = sum(size for _, size, _ in found)
    for _, size, path in sorted(found):
        if total <= LARGEST:
            break
        with contextlib.suppress(OSError):
            Path(path).unlink()
            total -= size


T = TypeVar("T")


def _always(result: object) -> bool:
    return True


def cached(
    compute: Callable[[], T],
    *contents: str,
    keep: Callable[[T], bool] = _always,
    fits: Callable[[T], bool] = _always,
) -> T:
    """The result of a computation, or an equal one from the cache.

    :param contents: everything that the result depends on, but the versions.
    :param keep: whether a result may be stored.
    :param fits: whether a stored result is still what would be computed.
    """
    if folder() is None:
        return compute()
    name = key(*contents, versions())
    stored = load(name)
    if stored is not None:
        found: T = pickle.loads(stored)  # noqa: S301  # as safe as the kernels there, which are executed
        if fits(found):
            return found
    result = compute()
    if not keep(result):
        return result
    content = pickle.dumps(result)
    store(name, content)
    copy: T = pickle.loads(content)  # noqa: S301  (just written)
    return copy  # whose digest is that of what is loaded later: see `records_digest`


@functools.cache
def versions() -> str:
    """Python, NumPy, whose arrays the records contain, and the state of every module of this package."""
    modules: list[str] = []
    folders = [str(Path(__file__).parent.parent)]
    while folders:
        with os.scandir(folders.pop()) as entries:
            for entry in entries:
                if entry.name.endswith(".py"):
                    state = entry.stat()
                    modules.append(f"{entry.path} {state.st_mtime_ns} {state.st_size}")
                elif "." not in entry.name and entry.is_dir():
                    folders.append(entry.path)
    return "\n".join([sys.version, np.__version__, *sorted(modules)])


def records_digest(records: object) -> str:
    """A digest of all records of a mechanism, by which results that depend on it are found.

    Equal mechanisms may have different digests, but different ones never have equal digests.
    """
    return hashlib.sha256(pickle.dumps(records)).hexdigest()


@functools.cache
def casadi_version() -> str:
    """The files of CasADi, by which one version differs from another, without importing it."""
    found = importlib.util.find_spec("casadi")
    if found is None or found.origin is None:
        return ""
    files = sorted(Path(found.origin).parent.glob("*casadi.*"))
    return " ".join(f"{path} {path.stat().st_mtime_ns} {path.stat().st_size}" for path in files)
