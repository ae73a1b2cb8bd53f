"""The metadata of a recording."""

import json

from mbd_sim import Simulation
from mbd_sim.recordings.messages.states import Snapshot
from mbd_sim.recordings.run.metadata import run_metadata


def test_metadata_contains_the_exact_step_and_start():
    simulation = Simulation.from_file("double_rod", step=1e-3 / 3)
    about = run_metadata(simulation)
    assert float.fromhex(about["step"]) == 1e-3 / 3
    assert exact(about["start"]) == simulation.state.tolist()
    assert about["method"] == "adams11"
    assert all(isinstance(value, str) for value in about.values())


def test_metadata_of_a_moment_contains_everything_the_motion_depends_on():
    simulation = Simulation.from_file("double_rod", live=["gravity[*]"], wrenches=["upper"])
    simulation.step(100)
    simulation.set_efforts([0.1, -0.2])
    simulation.set_wrench("upper", force=(1.0, 2.0, 3.0))
    simulation.set_live({"gravity[2]": -5.0})
    moment = Snapshot(250, 150_000_000, simulation.time, simulation.snapshot())
    kept = simulation.state.tolist(), simulation.inputs.tolist(), simulation.start_energy
    simulation.step(10)
    about = run_metadata(simulation, moment, {"publish_rate": 100.0})
    assert (exact(about["start"]), exact(about["inputs"])) == kept[:2]
    assert float.fromhex(about["start_energy"]) == kept[2]
    assert (about["first_tick"], about["first_step"], about["first_clock"]) == ("250", "100", "150000000")
    assert float.fromhex(json.loads(about["live"])["gravity[2]"]) == -5.0
    assert json.loads(about["parameters"]) == {"publish_rate": 100.0}


def exact(text):
    return [float.fromhex(value) for value in json.loads(text)]
