"""Recorded accelerations: what the message holds, and how it is verified."""

import numpy as np
import pytest

from mbd_sim import InputError, Simulation
from mbd_sim.recordings.messages import cdr
from mbd_sim.recordings.run.reader import open_recording
from mbd_sim.recordings.run.verification import verify
from test.recordings.rewriting import rewrite, with_bit_flipped


def test_accelerations_are_recorded_and_recomputed_bit_for_bit(tmp_path):
    sim = Simulation.from_file("moving_support_pendulum")
    with sim.recording(tmp_path / "run.mcap", accelerations=["*"]):
        sim.run(until=0.2)
    (found,) = verify(tmp_path / "run.mcap")
    assert found.agrees
    assert found.compared["accelerations"] == found.compared["joint_states"] == 21
    messages = [message for block in open_recording(tmp_path / "run.mcap").files[0].blocks for message in block.load()]
    last = cdr.multi_array([message for message in messages if message.topic == "/accelerations"][-1].payload)
    points = [
        name
        for part in sim.mechanism.parts.values()
        for name in (part.name, *(f"{part.name}.{p}" for p in part.points))
    ]
    assert last.labels == (*sim.coordinate_names, *sim.model.driven_names, *points)
    assert last.values[: len(sim.u)].tolist() == sim.u_rates.tolist()
    assert last.values[-3:].tolist() == sim.motion(points[-1]).acceleration.tolist()
    assert np.all(np.isfinite(last.values))


def test_points_are_where_live_values_put_them(tmp_path):
    sim = Simulation.from_file("double_rod", live=["parameters.l"])
    with sim.recording(tmp_path / "run.mcap", accelerations=["lower.tip"]):
        sim.set_live({"parameters.l": 1.3})
        sim.run(until=0.02)
    (found,) = verify(tmp_path / "run.mcap")
    assert found.agrees and found.compared["accelerations"] == 3
    messages = [message for block in open_recording(tmp_path / "run.mcap").files[0].blocks for message in block.load()]
    last = cdr.multi_array([message for message in messages if message.topic == "/accelerations"][-1].payload)
    assert last.values.tolist() == sim.motion("lower.tip").acceleration.tolist()


def test_unknown_points_are_refused(tmp_path):
    sim = Simulation.from_file("double_rod")
    with pytest.raises(InputError, match="'lower' has no point 'tp'"):
        sim.recording(tmp_path / "run.mcap", accelerations=["lower.tp"])
    with pytest.raises(InputError, match="ground, which does not move"):
        sim.recording(tmp_path / "run.mcap", accelerations=["ground"])
    with pytest.raises(InputError, match=r"'elbow' is a joint. Write 'coordinates' for"):
        sim.recording(tmp_path / "run.mcap", accelerations=["elbow"])


def test_a_damaged_acceleration_is_found(tmp_path):
    sim = Simulation.from_file("double_rod")
    with sim.recording(tmp_path / "run.mcap", accelerations=["coordinates", "lower.tip"]):
        sim.run(until=0.05)

    def change(number, message):
        if message.topic != "/accelerations" or message.sequence != 30:
            return message
        return with_bit_flipped(message, -8, 0)

    rewrite(tmp_path / "run.mcap", tmp_path / "damaged.mcap", change)
    (found,) = verify(tmp_path / "damaged.mcap")
    assert (found.differing, found.first.topic, found.first.name, found.first.tick) == (
        1,
        "/accelerations",
        "lower.tip",
        30,
    )
