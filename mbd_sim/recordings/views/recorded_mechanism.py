"""The mechanism of a recorded run, and the names that its topics stand for."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from mbd_sim.base.errors import MechanismError
from mbd_sim.files.load import parse_mechanism
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.recordings.messages.definitions import topic_names
from mbd_sim.recordings.run.reader import Recording


def recorded_mechanism(recording: Recording) -> Mechanism | None:
    """The mechanism of a run; None if the recording does not contain its file, or this program cannot read it."""
    if recording.mechanism_text is None:
        return None
    try:
        return parse_mechanism(recording.mechanism_text, str(recording.path))
    except MechanismError:
        return None


def names_by_topic(names: Iterable[str]) -> Mapping[str, str]:
    """The names of parts or sensors by the words that stand for them in topics."""
    return {token: name for name, token in topic_names(names).items()}
