"""Several simulators on one clock: one node leads, the others follow its /clock."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticArray

from mbd_sim.ros.node.sim_node import members
from test.system.growing_recordings import verified
from test.system.nodes import Listener, SimNodeProcess, as_in_the_node, nanoseconds, new_domain

MECHANISMS = {"left": "double_rod", "right": "rod_pendulum"}


@pytest.fixture
def pair(tmp_path: Path) -> Iterator[tuple[dict[str, SimNodeProcess], dict[str, Listener]]]:
    """A leader, paused at its start, and a node that follows it; and a listener to each."""
    domain = new_domain()
    special = {"left": {"start_paused": True, "reset_rewinds_clock": True}, "right": {"use_sim_time": True}}
    nodes = {
        name: SimNodeProcess(
            domain,
            tmp_path,
            {"mechanism": mechanism, "record": True, "record_dir": name, **special[name]},
            [f"__ns:=/{name}"],
        )
        for name, mechanism in MECHANISMS.items()
    }
    listeners = {name: Listener(domain, name) for name in MECHANISMS}
    for name, listener in listeners.items():
        listener.server, listener.process = f"/{name}/sim_node", nodes[name]
    try:
        yield nodes, listeners
    finally:
        for listener in listeners.values():
            listener.close()
        for node in nodes.values():
            node.kill()


def test_a_follower_takes_its_steps_on_the_leaders_clock_and_both_recordings_verify(pair, tmp_path: Path) -> None:
    nodes, listeners = pair
    left, right = listeners["left"], listeners["right"]
    for listener in (left, right):
        listener.until(lambda listener=listener: listener.states, "the start state")
    assert {nanoseconds(state.header.stamp) for state in right.states} == {0}
    left.pause(False)
    right.until(lambda: len(right.states) > 100, "states of the follower")
    message = right.states[-1]
    simulation = as_in_the_node("rod_pendulum")
    simulation.step(nanoseconds(message.header.stamp) // 1_000_000)
    assert list(message.position) == simulation.q.tolist()
    left.until(lambda: left.clocks and nanoseconds(left.states[-1].header.stamp) > 0, "states and clock of the leader")
    assert left.node.count_publishers("/clock") == 1

    left.pause(True)
    paused_ns = left.until_paused()
    right.until(lambda: nanoseconds(right.states[-1].header.stamp) == paused_ns, "the follower at the leader's pause")
    left.reset()  # with the clock: the follower starts again as well
    right.until(lambda: nanoseconds(right.states[-1].header.stamp) == 0, "the follower's return to the start")
    simulation.reset()
    assert list(right.states[-1].position) == simulation.q.tolist()
    left.pause(False)
    right.until(lambda: nanoseconds(right.states[-1].header.stamp) > 300e6, "the follower to go on")
    assert not right.set_parameter("real_time_factor", 2.0).successful
    assert not right.set_parameter("use_sim_time", False).successful
    for node in nodes.values():
        assert node.end() == 0, node.text
        assert "another node publishes /clock" not in node.text
    for name in MECHANISMS:
        result = verified(tmp_path / name)
        assert sum(result.compared.values()) > 100


def test_a_clock_rate_of_zero_creates_no_publisher_until_it_is_raised(tmp_path: Path) -> None:
    domain = new_domain()
    node = SimNodeProcess(domain, tmp_path, {"mechanism": "rod_pendulum", "clock_rate": 0})
    listener = Listener(domain)
    listener.process = node
    try:
        listener.until(lambda: listener.states, "states")
        assert listener.node.count_publishers("/clock") == 0
        assert listener.set_parameter("clock_rate", 100).successful
        listener.until(lambda: listener.clocks, "the clock")
        assert listener.set_parameter("clock_rate", 0).successful
        listener.until(lambda: listener.node.count_publishers("/clock") == 0, "the end of the publisher")
    finally:
        listener.close()
        node.kill()


def test_a_follower_without_a_clock_says_what_it_waits_for_and_ends_cleanly(tmp_path: Path) -> None:
    domain = new_domain()
    node = SimNodeProcess(domain, tmp_path, {"mechanism": "rod_pendulum", "use_sim_time": True, "record": True})
    listener = Listener(domain)
    listener.process = node
    messages: list[str] = []

    def take(message: DiagnosticArray) -> None:
        messages.extend(status.message for status in message.status)

    listener.node.create_subscription(DiagnosticArray, "/diagnostics", take, 10)
    try:
        listener.until(lambda: any("no /clock yet: start the node" in text for text in messages), "the warning")
        assert not listener.states
        assert node.end() == 0
        assert "Traceback" not in node.text
    finally:
        listener.close()
        node.kill()


def test_several_mechanisms_in_one_program_run_on_one_clock_each_in_its_namespace(tmp_path: Path) -> None:
    domain = new_domain()
    mechanisms = "'left=double_rod, right=rod_pendulum'"
    options = {"record": True, "record_dir": "logs", "real_time_factor": 0, "start_paused": True}
    node = SimNodeProcess(domain, tmp_path, {"mechanisms": mechanisms, **options})
    listeners = {name: Listener(domain, name) for name in MECHANISMS}
    for name, listener in listeners.items():
        listener.server, listener.process = f"/{name}/sim_node", node
    left, right = listeners["left"], listeners["right"]
    try:
        for listener in listeners.values():
            listener.until(lambda listener=listener: listener.states, "the start state")
        left.pause(False)
        for listener in listeners.values():
            listener.until(lambda listener=listener: nanoseconds(listener.states[-1].header.stamp) > 500e6, "states")
        left.until(lambda: left.clocks, "the clock")
        assert left.node.count_publishers("/clock") == 1
        left.pause(True)
        right.pause(False)
        message = right.states[-1]
        simulation = as_in_the_node("rod_pendulum")
        simulation.step(nanoseconds(message.header.stamp) // 1_000_000)
        assert list(message.position) == simulation.q.tolist()
        assert node.end() == 0, node.text
        assert "Traceback" not in node.text
    finally:
        for listener in listeners.values():
            listener.close()
        node.kill()
    paths = list((tmp_path / "logs").glob("*.mcap"))
    assert len(paths) == len(MECHANISMS)
    for path in paths:
        verified(path)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", []),
        ("double_rod, four_bar", [("double_rod", "double_rod"), ("four_bar", "four_bar")]),
        ("a=double_rod, b = ./x.yaml", [("a", "double_rod"), ("b", "./x.yaml")]),
    ],
)
def test_the_members_of_a_group(text: str, expected: list[tuple[str, str]]) -> None:
    assert [(member.namespace, member.mechanism) for member in members(text)] == expected


@pytest.mark.parametrize("text", ["a=double_rod, a=four_bar", "../x.yaml", "a="])
def test_members_without_a_namespace_of_their_own_are_refused(text: str) -> None:
    with pytest.raises(ValueError, match="Write NAMESPACE=MECHANISM"):
        members(text)
