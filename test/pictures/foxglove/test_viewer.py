"""What Foxglove's server sends over a real WebSocket, compared with the simulation."""

from __future__ import annotations

import base64
import threading

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.base import packages
from mbd_sim.base.geometry import rotation as rot
from mbd_sim.pictures.foxglove import FoxgloveViewer
from mbd_sim.pictures.foxglove.entities import MovingEntities, fixed_entities
from mbd_sim.pictures.foxglove.playback import Playback
from mbd_sim.pictures.foxglove.stream import FoxgloveStream
from mbd_sim.pictures.rerun import ViewerError
from mbd_sim.pictures.rerun.scene import DisplayOptions, PartPoses, RowMaker, Rows, describe_scene
from mbd_sim.pictures.shapes.joints import LONG
from mbd_sim.simulation.run.events import Event, EventKind
from test.pictures.foxglove.client import Client, fields, vector
from test.pictures.rerun.test_entities import TIED
from test.waiting import wait_until

SENSED = TIED + "sensors: {gauge: {type: tachometer, joint: slide, rate: 100 Hz}}\n"


def test_transforms_joints_energies_events_and_measurements_arrive_with_their_values() -> None:
    sim = Simulation.from_text(SENSED)
    states = []
    with FoxgloveViewer(sim.model, "0", rate=None) as viewer, Client(viewer.address) as client:
        wait_until(viewer.watched.is_set, "the client")
        for _ in range(5):
            states.append((sim.time, sim.poses()["bob"], sim.q[0], sim.u[0], sim.energies))
            viewer.offer(sim.time, sim.state, sim.inputs.copy(), sim.energies)
            sim.step(20)
        viewer.event(0.01, Event(EventKind.WARNING, "too hot"))
        for number, sample in sim.arrivals:
            viewer.measure(sim.time, "gauge", sim.sensor_model.reading(number, sample))
        viewer.flush()
        measured = "/sensors/gauge/velocity"
        client.receive(
            lambda: (
                len(client.messages["/energies"]) >= 5 and client.messages["/events"] and measured in client.topics()
            )
        )
        last = sim.sensor_model.reading(number, sample)  # again, until the topic is subscribed to
        client.receive(lambda: client.messages[measured], lambda: viewer.measure(sim.time, "gauge", last))
    assert client.info["name"] == "tied" and "time" in client.info["capabilities"]
    assert client.topics() == {
        "/tf": "foxglove.FrameTransforms",
        "/markers": "foxglove.SceneUpdate",
        "/joint_states": "mbd_sim.JointState",
        "/energies": "mbd_sim.Energies",
        "/events": "foxglove.Log",
        measured: "mbd_sim.velocity",
    }
    schema = next(one for one in client.channels.values() if one["topic"] == "/tf")
    assert b"foxglove.FrameTransform" in base64.b64decode(schema["schema"])
    received = zip(
        states,
        client.messages["/tf"][-5:],
        client.json("/joint_states")[-5:],
        client.json("/energies")[-5:],
        strict=True,
    )
    for (time, pose, q, u, energies), (stamp, transforms), joints, account in received:
        assert stamp == round(time * 1e9) == joints["header"]["stamp"]["nsec"]
        assert (joints["name"], joints["position"], joints["velocity"]) == (["slide"], [q], [u])
        assert [account[name] for name in energies._fields] == list(energies) == account["data"]
        transform = fields(fields(transforms)[1][0])
        assert (transform[2], transform[3]) == ([b"ground"], [b"bob"])
        np.testing.assert_array_equal(vector(transform[4][0]), pose.position)
        turned = np.roll(vector(transform[5][0], 4), 1)
        np.testing.assert_allclose(rot.from_quaternion(turned), pose.rotation, atol=1e-15)
    log = fields(client.messages["/events"][0][1])
    assert log[3][0].decode().endswith("too hot")
    assert client.json(measured)[-1]["value"] == pytest.approx(sim.u[0], abs=1e-9)
    assert client.times[-1] == round(states[-1][0] * 1e9)


def test_who_connects_late_gets_the_scene_and_the_last_sample() -> None:
    scene, rows = _scene(Simulation.from_text(TIED))
    stream = FoxgloveStream(scene, 0)
    stream.send_samples(rows.values)
    for _ in range(2):  # each of them
        with Client(stream.address) as client:
            client.receive(lambda: len(client.messages["/markers"]) > 1 and client.json("/joint_states"), stream.flush)
            first = [fields(entity) for entity in fields(client.messages["/markers"][0][1])[2]]
            assert {one[3][0] for one in first} >= {b"parts/bob", b"parts/ground"}
            assert client.json("/joint_states")[-1]["position"] == [-1.0]
    stream.close()


def test_fixed_entities_move_with_their_parts_and_the_ball_has_its_size() -> None:
    scene, _ = _scene(Simulation.from_text(TIED))
    read = {one[3][0].decode(): one for one in (fields(entity.encode()) for entity in fixed_entities(scene))}
    bob = read["parts/bob"]
    assert bob[2] == [b"bob"] and bob[5] == [1]  # in its frame, and locked to it
    (ball,) = bob[9]
    np.testing.assert_allclose(vector(fields(ball)[2][0]), 0.2)


def test_springs_reach_from_end_to_end_and_forces_are_to_scale() -> None:
    sim = Simulation.from_text(TIED)
    sim.step(300)
    scene, rows = _scene(sim)
    (entities,) = MovingEntities(scene).of(rows, PartPoses(scene, rows))
    read = {one[3][0].decode(): one for one in (fields(entity.encode()) for entity in entities)}
    coil, damper = (np.array([vector(point) for point in fields(line)[5]]) for line in read["connectors"][11])
    top = sim.poses()["bob"].position + np.array([0.0, 0.0, 0.1])
    np.testing.assert_allclose(coil[[0, -1]], [[0.3, 0.0, 0.0], top], atol=1e-12)
    assert len(damper) % 2 == 0
    arrow = fields(read["forces"][7][0])
    length = LONG * scene.extent.size * abs(np.sin(4.0 * sim.time))
    assert arrow[2][0] + arrow[4][0] == pytest.approx(length, rel=2e-3)
    np.testing.assert_allclose(vector(fields(arrow[1][0])[1][0]), top, atol=1e-12)


def test_a_port_that_is_taken_or_none_is_refused() -> None:
    sim = Simulation.from_text(TIED)
    stream = FoxgloveStream(_scene(sim)[0], 0)
    port = int(stream.address.rpartition(":")[2])
    with pytest.raises(ViewerError, match=rf"nothing can listen on port {port}.*Choose another"):
        FoxgloveStream(_scene(sim)[0], port)
    stream.close()
    with pytest.raises(ViewerError, match=r"no port 'spawn' for Foxglove.*such as 8765"):
        FoxgloveViewer(sim.model, "spawn")


def test_without_the_package_the_line_that_installs_it_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(packages, "_is_installed", lambda module: module != "foxglove")
    with pytest.raises(ViewerError, match=r"The viewer needs foxglove.*pip install foxglove-sdk"):
        FoxgloveViewer(Simulation.from_text(TIED).model, "0")


def _scene(sim: Simulation):
    maker = RowMaker(sim.model)
    scene = describe_scene(sim.model, maker.layout, DisplayOptions())
    row = maker.row(sim.time, sim.time, sim.state, sim.inputs.copy(), sim.energies)
    return scene, Rows(maker.layout, row[None])


def test_a_recorded_run_plays_stops_at_its_end_and_is_searched() -> None:
    sim = Simulation.from_text(TIED)
    maker = RowMaker(sim.model)
    playback = Playback(_scene(sim)[0], 0)
    rows, times, positions = [], [], []
    while sim.time < 0.2:
        rows.append(maker.row(sim.time, sim.time, sim.state, sim.inputs.copy(), sim.energies))
        times.append(round(sim.time * 1e9))
        positions.append(float(sim.q[0]))
        sim.step(10)
    playback.send_samples(np.array(rows))
    playback.flush()
    stop = threading.Event()
    player = threading.Thread(target=playback.play, args=(stop,))
    player.start()
    try:
        with Client(playback.address) as client:
            received = client.messages["/joint_states"]
            client.receive(lambda: received and received[-1][0] == times[-1])
            assert sorted({time for time, _ in received}) == times
            before = len(received)
            client.control(play=False, speed=1.0, seek_ns=times[4] + 1)
            client.receive(lambda: len(received) > before)
            assert received[-1][0] == times[4]
            assert client.json("/joint_states")[-1]["position"] == [positions[4]]
    finally:
        stop.set()
        player.join()
        playback.close()
    assert "playbackControl" in client.info["capabilities"] and client.info["dataEndTime"]["nsec"] == times[-1]
