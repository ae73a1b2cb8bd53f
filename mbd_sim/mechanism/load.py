"""Mechanism files to `Mechanism` records."""

from __future__ import annotations

from pathlib import Path

from mbd_sim.mechanism.build import build
from mbd_sim.mechanism.library import find
from mbd_sim.mechanism.model import Mechanism
from mbd_sim.mechanism.source import Source, parse_source, read_source
from mbd_sim.mechanism.validate import validate


def load_mechanism(mechanism: str | Path) -> Mechanism:
    """Load a mechanism file, given by its path or by the name of a shipped mechanism.

    :raises MechanismError: with all problems of the file, each with its line and a remedy.
    """
    return _from_source(read_source(find(mechanism)))


def parse_mechanism(text: str, file: str = "<text>") -> Mechanism:
    """The mechanism that YAML text describes; `file` names it in errors.

    :raises MechanismError: see `load_mechanism`.
    """
    return _from_source(parse_source(text, file))


def _from_source(source: Source) -> Mechanism:
    file, parameters = validate(source)
    return build(file, parameters, source)
