"""Events: their texts, and reading recorded texts back."""

import numpy as np
import pytest

from mbd_sim.simulation.run.events import AppliedEfforts, AppliedWrench, ChangedValues, Event, EventKind, parse_event

# Every wording that version 0.1.0 and those before it recorded.
RECORDED = {
    "command": (EventKind.COMMAND, None),
    "commands expired: efforts set to zero": (EventKind.EXPIRED, AppliedEfforts),
    "commands expired: effort of hip, knee set to zero": (EventKind.EXPIRED, AppliedEfforts),
    "commands expired: wrench on lower set to zero": (EventKind.EXPIRED, AppliedWrench),
    "commands expired: wrench on rod 2 set to zero": (EventKind.EXPIRED, AppliedWrench),
    "paused": (EventKind.PAUSED, None),
    "running": (EventKind.RUNNING, None),
    "reset": (EventKind.RESET, None),
    "new state": (EventKind.NEW_STATE, None),
    "clock set to zero": (EventKind.CLOCK_RESET, None),
    "clock set: to 2.5 s after the pause": (EventKind.CLOCK_SET, str),
    "live values: gravity[2] = -1.6": (EventKind.LIVE_VALUES, ChangedValues({"gravity[2]": -1.6})),
    "live values: parameters.l = 0.5, joints.pin.damping = 1e-05": (
        EventKind.LIVE_VALUES,
        ChangedValues({"parameters.l": 0.5, "joints.pin.damping": 1e-5}),
    ),
    "live values: joints.my pin.damping = 2.0": (
        EventKind.LIVE_VALUES,
        ChangedValues({"joints.my pin.damping": 2.0}),
    ),
    "contact: left: impact at 0.563676 s, impulse 0.194, loss 0.01968 J": (EventKind.CONTACT, str),
    "warning: a step of 0.2 s is too large for rod_pendulum: the error of a step is estimated at 0.1. Try step 0.01.": (
        EventKind.WARNING,
        str,
    ),
    "diverged: rod_pendulum: the motion became infinite between t = 0 s and 0.1 s.": (EventKind.DIVERGED, str),
    "failed: ZeroDivisionError('division by zero')": (EventKind.FAILED, str),
}


@pytest.mark.parametrize("text", RECORDED)
def test_a_recorded_text_becomes_the_event_that_wrote_it(text):
    kind, payload = RECORDED[text]
    event = parse_event(text, ticks=7, clock_ns=7_000_000)
    assert (event.kind, event.text, event.ticks, event.clock_ns) == (kind, text, 7, 7_000_000)
    if isinstance(payload, type):
        assert isinstance(event.payload, payload)
    else:
        assert event.payload == payload


def test_every_kind_that_a_run_reports_has_a_recorded_text():
    assert {kind for kind, _ in RECORDED.values()} == set(EventKind) - {EventKind.NOTE}


@pytest.mark.parametrize(
    "text",
    ["", "note", "note: x", "released", "reset the arm", "paused: x", "live values: none", "live values",
     "commands expired: soon", "live values: a = 1.0, b", "warning"],
)  # fmt: skip
def test_any_other_text_is_a_note(text):
    assert parse_event(text).kind is EventKind.NOTE
    assert parse_event(text).text == text


@pytest.mark.parametrize(
    ("event", "text"),
    [
        (Event(EventKind.COMMAND, AppliedEfforts(np.zeros(2))), "command"),
        (Event(EventKind.COMMAND, AppliedWrench("rod", np.zeros(15))), "command"),
        (Event(EventKind.EXPIRED, AppliedEfforts(np.zeros(2))), "commands expired: efforts set to zero"),
        (
            Event(EventKind.EXPIRED, AppliedEfforts(np.zeros(2), ("hip", "knee"))),
            "commands expired: effort of hip, knee set to zero",
        ),
        (Event(EventKind.EXPIRED, AppliedWrench("rod", np.zeros(15))), "commands expired: wrench on rod set to zero"),
        (
            Event(EventKind.LIVE_VALUES, ChangedValues({"a.b": 1e300, "c": -0.1}, {})),
            "live values: a.b = 1e+300, c = -0.1",
        ),
        (Event(EventKind.WARNING, "too large."), "warning: too large."),
        (Event(EventKind.RESET), "reset"),
    ],
)
def test_an_event_has_a_text_that_can_be_read_back(event, text):
    assert event.text == text
    assert parse_event(text).kind is event.kind
    assert parse_event(text).text == text


def test_changed_values_are_read_back_to_the_last_bit():
    values = {f"parameters.p{k}": float(value) for k, value in enumerate(np.random.default_rng(1).normal(size=50))}
    payload = parse_event(Event(EventKind.LIVE_VALUES, ChangedValues(values)).text).payload
    assert payload == ChangedValues(values)
