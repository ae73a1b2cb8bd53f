"""Events in compiled code: as they were before it, and as the code for all contacts has them."""

from __future__ import annotations

import pytest

from mbd_sim import Simulation
from mbd_sim.compiler.ir.python_kinds import Array, Integers
from mbd_sim.simulation.contact.compiled import library, step
from mbd_sim.simulation.contact.compiled.instant.contacts import Contacts
from mbd_sim.simulation.contact.stepper import OneSidedStepper
from test.generators.contact_mechanisms import contact_mechanism

# End, q and u, number of events and time of the last one, as they were computed in Python, NumPy and CasADi.
BEFORE = {
    "bounce": (2.0, "0x1.0affe12f7806cp-2 -0x1.53b3328eab33bp-3", 3, "0x1.c07d49750cb7dp+0"),
    "belt": (1.5, "0x1.4bfb73341b0efp-5 0x1.84dd40a26a90ap-3", 5, "0x1.7e50181663314p+0"),
    "spinning_ball": (
        1.05,
        "-0x1.4912f3c12325cp-2 -0x1.eab20d222cb26p-4 -0x1.eb7498c88e3eap+4 -0x1.6db6db6db6dbap-1 0x1.b0fcf15e48de2p-1 "
        "-0x1.c924924924924p+2",
        2,
        "0x1.b6a226fc25f51p-1",
    ),
    "woodpecker": (
        0.3,
        "-0x1.528ddf9035624p-5 -0x1.a7b9611a7b8d8p-4 -0x1.e951d0684e5f9p-3 -0x1.85197db9122f1p-5 -0x1.0967c5b8d0eb9p-2 "
        "-0x1.0000000000000p-96 -0x1.0af86a56b0cecp+3 -0x1.898d177c07116p-2",
        26,
        "0x1.11cc4bd14be43p-2",
    ),
    "backlash": (
        1.0,
        "0x1.007ff4377f204p-2 0x1.1cf59e18790f4p-2 0x1.81cbde3611455p-3 -0x1.94443d3a3f8f5p-4",
        6,
        "0x1.e6fd3f9fa49e4p-1",
    ),
    "rocking": (
        1.5,
        "0x1.350043862af5ap-5 -0x1.a1f708f17e5bfp-2 0x1.a66225c8e58ddp-4 0x1.ba46fbcae6ecfp-6 -0x1.f95156ada8b2ap-9 "
        "0x1.0ee41d9c56fd9p-4",
        8,
        "0x1.40e3cc181fd32p+0",
    ),
    "four_bar_clearance": (
        0.5,
        "0x1.8bfe7352d8354p+2 -0x1.4945dcccec012p+2 0x1.d1d5b0f552f07p+0 0x1.b1263318d6e06p+2 -0x1.40ae26e254791p+3 "
        "-0x1.d362f38956fcfp+1",
        20,
        "0x1.fdf3f2024859cp-2",
    ),
}


@pytest.mark.parametrize("name", BEFORE)
def test_events_have_the_bits_of_before(name):
    """Recordings that were made before must verify."""
    until, numbers, count, last = BEFORE[name]
    simulation = Simulation.from_file(name, method="tsitouras8")
    simulation.run(until)
    assert " ".join(value.hex() for value in [*simulation.q.tolist(), *simulation.u.tolist()]) == numbers
    assert len(simulation.contact_events) == count
    assert simulation.contact_events[-1].time.hex() == last


def leaves_all(
    c: Contacts,
    t: float,
    y: Array,
    inputs: Array,
    readings: Array,
    terms: Array,
    opening: Integers,
    yielding: Integers,
    sliding: Integers,
) -> bool:
    """In place of the search for modes; compiled."""
    return False


def history(text, until):
    simulation = Simulation.from_text(text)
    simulation.run(until)
    return simulation.state.tolist(), simulation.contact_events


@pytest.mark.usefixtures("compiled_anew")
def test_simple_events_are_those_of_the_code_for_all_contacts(monkeypatch):
    """Impacts and modes of random mechanisms, with loops, chains, plays and corners, computed in both ways."""
    kinds = (
        "block",
        "chain",
        "rotors",
        "two_loops",
        "flat_bodies",
        "limited_joints",
    )
    texts = [contact_mechanism(seed, kind) for seed, kind in enumerate(kinds)]
    compiled = [history(text, 0.5) for text in texts]
    monkeypatch.setattr(step, "find_modes", leaves_all)
    library.library.cache_clear()
    calls, decide = [], OneSidedStepper._decide

    def counted(self, *arguments):
        calls.append(1)
        return decide(self, *arguments)

    monkeypatch.setattr(OneSidedStepper, "_decide", counted)
    assert [history(text, 0.5) for text in texts] == compiled
    assert len(calls) > len(kinds)


def test_few_events_are_left_to_the_code_for_all_contacts(monkeypatch):
    """It takes some ten times as long."""
    calls, decide = [], OneSidedStepper._decide

    def counted(self, *arguments):
        calls.append(1)
        return decide(self, *arguments)

    monkeypatch.setattr(OneSidedStepper, "_decide", counted)
    for name in ("bounce", "rope", "stops", "rocking", "spinning_ball", "freewheel", "backlash", "belt", "woodpecker"):
        Simulation.from_file(name).run(1.0)
    assert not calls


def test_an_observer_sees_the_events_and_energies_of_compiled_impacts():
    class Seen:
        def __init__(self):
            self.impacts, self.events = [], []

        def impact(self, time, before, after):
            self.impacts.append((time, before, after))

        def event(self, event):
            self.events.append(event)

    seen, simulation = Seen(), Simulation.from_file("bounce")
    simulation.observe_contacts(seen)
    simulation.run(2.0)
    assert tuple(seen.events) == simulation.contact_events
    assert [time for time, _, _ in seen.impacts] == [event.time for event in seen.events]
    losses = [before - after for _, before, after in seen.impacts]
    assert losses == pytest.approx([event.loss for event in seen.events], rel=1e-12)
