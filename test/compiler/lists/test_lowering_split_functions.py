"""Split instruction lists compute the same values as whole ones, bit for bit."""

from __future__ import annotations

import pytest

from mbd_sim import Simulation
from mbd_sim.compiler.lists import lowering
from mbd_sim.compiler.lists.instruction_list import instructions_of
from mbd_sim.compiler.lists.lowering import live_out
from mbd_sim.dynamics.equations import derive
from mbd_sim.files.load import load_mechanism


@pytest.mark.parametrize("size", [1, 7, 100])
@pytest.mark.parametrize("method", ["rk4", "rosenbrock"])
def test_pieces_give_the_same_bits(monkeypatch, size, method):
    whole = Simulation.from_file("moving_support_pendulum", method=method)
    monkeypatch.setattr(lowering, "PIECE", size)
    monkeypatch.setattr(lowering, "UNSPLIT", size)
    cut = Simulation.from_file("moving_support_pendulum", method=method)
    whole.step(100)
    cut.step(100)
    assert cut.state.tobytes() == whole.state.tobytes()


def test_nothing_is_live_out_that_nobody_reads():
    rates = derive(load_mechanism("double_rod")).rates
    instructions = instructions_of(rates)
    count = len(instructions)
    halves = [range(count // 2), range(count // 2, count)]
    first, last = live_out(instructions, halves)
    assert last == set()
    assert 0 < len(first) < rates.sz_w()
    assert live_out(instructions, [range(count)]) == [set()]
