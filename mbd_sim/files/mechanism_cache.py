"""Mechanism files that were read before: loaded from the cache on disk, without the schema and its libraries.

A mechanism is found by its text, the name of its file, and the version of this package and of what it is built with. It
is stored with the digests of the other files that it depends on, such as a URDF that it extends, and is read again if
one of these has changed. So is what else needs the schema at every start.
"""

from __future__ import annotations

import functools
import hashlib
import importlib.util
import os
import pickle
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import numpy as np

from mbd_sim.base import disk_cache
from mbd_sim.files.text.file_limits import digest_of_file
from mbd_sim.mechanism.mechanism import Mechanism

T = TypeVar("T")


def cached_mechanism(text: str, file: str, base: str | None, parse: Callable[[], Mechanism]) -> Mechanism:
    """The mechanism that `parse` returns, or an equal one from the cache.

    :param text: all that `parse` reads, unless the file names another one; `file` and `base` as in `parse_mechanism`.
    """
    return cached(parse, "mechanism", text, file, base or "", keep=_is_found_again, fits=_is_unchanged)


def _is_found_again(mechanism: Mechanism) -> bool:
    return mechanism.source.other_files is not None


def _is_unchanged(mechanism: Mechanism) -> bool:
    """Whether the other files that a mechanism depends on are those that were read for it."""
    read = mechanism.source.other_files or {}
    return all(digest_of_file(Path(path)) == digest for path, digest in read.items())


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
    if disk_cache.folder() is None:
        return compute()
    key = disk_cache.key(*contents, versions())
    stored = disk_cache.load(key)
    if stored is not None:
        found: T = pickle.loads(stored)  # noqa: S301  # as safe as the kernels there, which are executed
        if fits(found):
            return found
    result = compute()
    if not keep(result):
        return result
    content = pickle.dumps(result)
    disk_cache.store(key, content)
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


def records_digest(mechanism: Mechanism) -> str:
    """A digest of all records of a mechanism, by which results that depend on it are found.

    Equal mechanisms may have different digests, but different ones never have equal digests.
    """
    return hashlib.sha256(pickle.dumps(mechanism)).hexdigest()


@functools.cache
def casadi_version() -> str:
    """The files of CasADi, by which one version differs from another, without importing it."""
    found = importlib.util.find_spec("casadi")
    if found is None or found.origin is None:
        return ""
    files = sorted(Path(found.origin).parent.glob("*casadi.*"))
    return " ".join(f"{path} {path.stat().st_mtime_ns} {path.stat().st_size}" for path in files)
