"""The session on the run of a node: what it sends for each control, and what it shows of the node's states."""

import json
import pickle
import socket
from functools import partial

import numpy as np
import pytest

from mbd_sim import Kinematics, inverse_kinematics
from mbd_sim.base.errors import CommandError
from mbd_sim.files.load import load_mechanism
from mbd_sim.lab.session.bench import Bench
from mbd_sim.lab.session.link import NodeState, SocketEnd
from mbd_sim.lab.session.node_session import NodeSession
from mbd_sim.lab.session.reaching import Reacher
from mbd_sim.simulation.run.simulation import BaseSimulation


class Node:
    """The node's end, with a simulation of its own."""

    def __init__(self):
        ours, theirs = socket.socketpair()
        mechanism = load_mechanism("cart_pendulum")
        options = {"wrenches": ["pendulum"], "live": ["parameters.*"]}
        self.simulation, self.link = BaseSimulation(mechanism, **options), SocketEnd(ours, blocking=False)
        self.session = NodeSession(Bench(BaseSimulation(mechanism, **options)), SocketEnd(theirs, blocking=True))
        self.running, self.told = True, ""

    def turn(self):
        """One turn of the session; its requests."""
        state = NodeState(self.simulation.snapshot(), self.running, 1.0, "run.mcap", self.told)
        self.link.send(pickle.dumps(state))
        self.session.turn()
        return json.loads(self.link.receive())["requests"]


@pytest.fixture
def node():
    made = Node()
    yield made
    made.link.close()
    made.session._link.close()


def test_each_control_is_a_request(node):
    session = node.session
    asked = {
        "play": (lambda one: one.play(), [["pause", False]]),
        "step": (lambda one: one.step(), [["pause", True], ["step"]]),
        "reset": (lambda one: one.reset(), [["reset"]]),
        "speed": (lambda one: one.set_speed(0.5), [["speed", 0.5]]),
        "fastest": (lambda one: one.set_speed(np.inf), [["speed", 0.0]]),
        "value": (lambda one: one.change("parameters.l", 0.3), [["live", {"parameters.l": 0.3}]]),
        "effort": (lambda one: one.set_effort("rail", 2.0), [["effort", "rail", 2.0]]),
        "command": (lambda one: one.set_command("drive.velocity", 1.0), [["command", "drive.velocity", 1.0]]),
        "position": (lambda one: one.set_state({"rail": 0.1}, {}), [["state", {"rail": 0.1}, {}]]),
        "record": (lambda one: one.record("any"), [["record", True]]),
        "end": (lambda one: one.end_recording_told(), [["record", False]]),
    }
    for name, (request, sent) in asked.items():
        session.ask(name, request)
        assert node.turn() == sent, name
    assert node.turn() == []


def test_live_values_of_a_tenth_of_a_second_are_one_change(node):
    """A page that moves sliders as fast as it can must not keep the node validating."""
    session, sent = node.session, []
    now = session._clock()
    for turn in range(60):
        session._clock = lambda turn=turn: now + turn / 60.0
        session.ask("value", lambda one, turn=turn: one.change("parameters.l", 0.3 + 1e-3 * turn))
        sent += node.turn()
    assert 9 <= len(sent) <= 11
    session._clock = lambda: now + 2.0
    assert node.turn() == [["live", {"parameters.l": 0.359}]]


def test_the_states_of_the_node_are_shown(node):
    node.simulation.set_efforts({"rail": 3.0})
    node.simulation.step(500)
    node.told = "rejected"
    node.turn()
    frame = node.session.frame
    assert (frame.time, frame.running, frame.recording, frame.message) == (0.5, True, "run.mcap", "rejected")
    assert frame.values["rail"] == 3.0
    assert frame.positions.tolist() == node.simulation.model.coordinates(node.simulation.y).tolist()
    node.simulation.step(500)
    node.turn()
    assert node.session.frame.span == (0.5, 1.0) or len(node.session.history) == 1
    node.simulation.reset()
    node.turn()
    assert node.session.frame.time == 0.0
    assert len(node.session.samples.rows) == 1


def test_time_is_not_wound_back(node):
    node.session.ask("wind", lambda one: one.wind_to(0.1))
    assert node.turn() == []
    assert node.session.frame.message == "a node is not wound back. Reset it."


def test_a_pull_is_repeated_until_the_hand_lets_go_or_its_page_is_closed(node):
    node.turn()
    for end, sent in (("end", ["release", "pendulum"]), ("leave", ["abandon", "pendulum"])):
        node.session.ask("drag", lambda one: one.drag(7, "start", "pendulum", np.zeros(3), np.ones(3)))
        for _ in range(3):
            ((name, part, point, target, stiffness, damping, strongest),) = node.turn()
            assert (name, part, point, target) == ("pull", "pendulum", [0.0] * 3, [1.0] * 3)
            assert stiffness > 0.0
            assert damping > 0.0
            assert strongest == pytest.approx(10.0 * 9.80665 * 1.2)
        assert node.session.frame.pull is not None
        if end == "end":
            node.session.ask("end", lambda one: one.drag(7, "end", "pendulum", np.zeros(3), np.ones(3)))
        else:
            node.session.ask("page 7", lambda one: one.leave(7))
        assert node.turn() == [sent]
        assert node.turn() == []


def test_a_pause_of_others_ends_a_pull(node):
    node.turn()
    node.session.ask("drag", lambda one: one.drag(7, "start", "pendulum", np.zeros(3), np.ones(3)))
    node.turn()
    node.running = False
    node.turn()
    assert node.turn() == [["release", "pendulum"]]


def test_a_part_that_accepts_no_wrench_is_not_pulled(node):
    node.turn()
    node.session.ask("drag", lambda one: one.drag(7, "start", "cart", np.zeros(3), np.ones(3)))
    assert node.turn() == []
    assert "part 'cart' accepts no wrench" in node.session.frame.message


def test_dragging_a_paused_mechanism_sends_its_positions(node):
    node.running = False
    node.turn()
    node.session.ask("drag", lambda one: one.drag(7, "start", "pendulum", np.array([0.0, 0.0, 0.3]), np.ones(3)))
    ((name, positions, speeds),) = node.turn()
    assert name == "place"
    assert positions.keys() == speeds.keys() == set(node.simulation.coordinate_names)
    assert positions != dict(zip(node.simulation.coordinate_names, node.simulation.q.tolist(), strict=True))


def test_what_inverse_kinematics_finds_pauses_the_node_and_is_its_state(node):
    found = inverse_kinematics(
        Kinematics(node.simulation.mechanism), "pendulum", at=[0, 0, 0.3], position=[0.1, 0, 0.3]
    )
    node.session.ask("reach", lambda one: one.put(found))
    (pause, (name, positions, speeds)) = node.turn()
    assert (pause, name) == (["pause", True], "place")
    assert positions == pytest.approx(found.positions, abs=1e-12)
    assert set(speeds.values()) == {0.0}


def test_what_would_be_inside_something_is_refused_before_the_node_is_asked(node, monkeypatch):
    """Reached, says the panel, whose mechanism the node has not put there."""

    def refuse(*_):
        raise CommandError("the ball would be 0.1 m beyond its bound")

    monkeypatch.setattr("mbd_sim.lab.session.node_session.require_outside", refuse)
    found = inverse_kinematics(Kinematics(node.simulation.mechanism), "pendulum", position=[0.1, 0, 0])
    reacher = Reacher(node.session)
    reacher.found = found
    node.session.ask("reach", partial(reacher._put, found))
    assert node.turn() == []
    assert "beyond its bound" in reacher.refused == node.session.message
    reacher.stop()


def test_the_session_ends_with_the_node(node):
    node.link.close()
    node.session.turn()
    node.session.wait()
