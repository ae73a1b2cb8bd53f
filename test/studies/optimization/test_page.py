"""The page runs: the swing-up ends upright in the simulation too, and the predictive controller balances."""

import re
from pathlib import Path

import numpy as np

from mbd_sim import Simulation

PAGE = Path(__file__).parents[3] / "docs" / "optimization.md"


def test_the_snippets_of_the_page(capsys):
    values = {}
    for block in re.findall(r"^```python\n(.*?)^```$", PAGE.read_text(encoding="utf-8"), re.M | re.S):
        exec(compile(block, str(PAGE), "exec"), values)
    assert "from upright" in capsys.readouterr().out
    truth = {"mc": 1.0, "m": 0.2, "l": 0.8}
    assert all(abs(one.value - truth[key]) < 4 * one.error for key, one in values["found"].estimates.items())
    lengths = {"crank": 0.5, "coupler": 1.4}
    assert all(abs(one.value - lengths[key]) < 4 * one.error for key, one in values["lengths"].estimates.items())
    assert values["found"].estimates["l"].error < 0.02 and values["lengths"].estimates["crank"].error < 1e-3
    sim = values["sim"]
    assert abs(sim.q[0]) < 0.05 and abs(sim.q[1] - np.pi) < 0.01
    replayed = Simulation.from_file("cart_pendulum")  # with the forces of the swing-up between the knots
    replayed.reset(q=[0.0, 0.0], u=[0.0, 0.0])
    count = values["intervals"] * 20
    knots = np.linspace(0.0, values["duration"], values["intervals"] + 1)
    for index in range(count):
        middle = (index + 0.5) * values["duration"] / count
        replayed.set_efforts([float(np.interp(middle, knots, values["best"])), 0.0])
        replayed.run(until=(index + 1) * values["duration"] / count)
    assert abs(replayed.q[1] - np.pi) < 0.1 and abs(replayed.q[0]) < 0.1
