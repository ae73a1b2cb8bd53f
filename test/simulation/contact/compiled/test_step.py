"""Events in compiled code: as they were before it, and as the code for all contacts has them."""

from __future__ import annotations

import pytest

from mbd_sim import Simulation
from mbd_sim.compiler.ir.python_kinds import Array, Integers
from mbd_sim.simulation.contact.compiled import step
from mbd_sim.simulation.contact.compiled.instant.contacts import Contacts
from mbd_sim.simulation.contact.stepper import OneSidedStepper
from test.generators.contact_mechanisms import contact_mechanism
from test.simulation.contact.test_rest import JERK

# End, q and u, number of events and time of the last one, as version 0.17.0 has them.
BEFORE = {
    "belt": (1.5, "0x1.4bfb73341b0efp-5 0x1.84dd40a26a90ap-3", 5, "0x1.7e50181663314p+0"),
    "woodpecker": (
        0.3,
        "-0x1.528ddf903562ep-5 -0x1.a7b9611a7b8a3p-4 -0x1.e951d0684e5f2p-3 -0x1.85197db9122f8p-5 -0x1.0967c5b8d0eb0p-2 "
        "0x1.0000000000000p-96 -0x1.0af86a56b0ce5p+3 -0x1.898d177c0710ap-2",
        26,
        "0x1.11cc4bd14be3fp-2",
    ),
    "rocking": (
        1.5,
        "0x1.350043862afabp-5 -0x1.a1f708f17e5c0p-2 0x1.a66225c8e5938p-4 0x1.ba46fbcae739ep-6 -0x1.f95156ada9058p-9 "
        "0x1.0ee41d9c572c8p-4",
        8,
        "0x1.40e3cc181fd3ap+0",
    ),
    "four_bar_clearance": (
        0.5,
        "0x1.8bfe7352d835ep+2 -0x1.4945dcccec025p+2 0x1.d1d5b0f552ef5p+0 0x1.b1263318d6ae0p+2 -0x1.40ae26e254962p+3 "
        "-0x1.d362f38956c5ap+1",
        20,
        "0x1.fdf3f2024785bp-2",
    ),
}


@pytest.fixture
def decided(monkeypatch):
    """The calls of the code for all contacts."""
    calls, decide = [], OneSidedStepper._decide

    def counted(self, *arguments):
        calls.append(1)
        return decide(self, *arguments)

    monkeypatch.setattr(OneSidedStepper, "_decide", counted)
    return calls


@pytest.mark.parametrize("name", BEFORE)
def test_events_have_the_bits_of_before(name, decided):
    """Recordings that were made before must verify. The code for all contacts, which takes ten times as long, has no part."""
    until, numbers, count, last = BEFORE[name]
    simulation = Simulation.from_file(name, method="tsitouras8")
    simulation.run(until)
    assert " ".join(value.hex() for value in [*simulation.q.tolist(), *simulation.u.tolist()]) == numbers
    assert len(simulation.contact_events) == count
    assert simulation.contact_events[-1].time.hex() == last
    assert not decided


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


def test_simple_events_are_those_of_the_code_for_all_contacts(request, monkeypatch, decided):
    """Impacts and modes of random mechanisms, with loops, chains, plays and corners, and what returns at once, both ways."""
    kinds = {"rotors": 2, "two_loops": 3}
    texts = [contact_mechanism(seed, kind) for kind, seed in kinds.items()]
    texts += [JERK.replace("m: 1}", f"m: {mass}}}") for mass in (1e-7, 1e-3)]
    compiled = [history(text, 0.5) for text in texts]
    monkeypatch.setattr(step, "find_modes", leaves_all)
    request.getfixturevalue("compiled_anew")
    decided.clear()
    assert [history(text, 0.5) for text in texts] == compiled
    assert len(decided) > len(texts)
