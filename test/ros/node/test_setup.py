"""A start that takes long says what it does, for how long so far, and when it is done."""

import logging
from types import SimpleNamespace

import pytest

from mbd_sim.base import packages
from mbd_sim.ros.node import setup
from mbd_sim.ros.node.setup import BuildProgress, lab_page
from test.waiting import wait_until

LOG = logging.getLogger("mbd_sim.simulation.any")


class Node:
    """Records what a node would log and publish."""

    def __init__(self):
        self.logged, self.published, self.publishers = [], [], 0

    def get_logger(self):
        return self

    def info(self, text):
        self.logged.append(text)

    def create_publisher(self, *_, **__):
        self.publishers += 1
        return self

    def destroy_publisher(self, publisher):
        self.publishers -= 1

    def publish(self, message):
        self.published.append(message.data)


@pytest.fixture
def node(monkeypatch):
    made = Node()
    monkeypatch.setattr(setup, "TopicPublisher", lambda node, topic: type("P", (), {"publisher": made}))
    made.publishers = 1
    return made


def test_what_is_being_done_is_said_again_and_again_with_the_time(node, monkeypatch):
    monkeypatch.setattr(setup, "PATIENCE", 0.01)
    monkeypatch.setattr(setup, "PERIOD", 0.01)
    with BuildProgress(node, "reading robot.urdf"):
        wait_until(lambda: len(node.logged) >= 2, "two reports")
        LOG.debug("deriving the equations of 'robot': 3 joints")
        wait_until(lambda: "deriving" in node.logged[-1], "the next phase")
    assert node.logged[:2] == ["reading robot.urdf: 0 s so far"] * 2
    assert node.logged[-1].startswith("done after 0.") and node.published == node.logged
    assert not node.publishers and LOG.getEffectiveLevel() > logging.INFO


def test_messages_of_the_level_info_appear_at_once(node):
    with BuildProgress(node, "reading robot.urdf"):
        LOG.info("compiling 1.0 MB of intermediate code")
        assert node.logged == ["compiling 1.0 MB of intermediate code"]


def test_a_short_start_says_nothing(node):
    with BuildProgress(node, "reading robot.urdf"):
        LOG.debug("deriving the equations of 'robot': 3 joints")
    assert not node.logged and not node.published


def test_without_viser_the_node_says_how_to_install_it_and_goes_on(monkeypatch):
    monkeypatch.setattr(packages, "_is_installed", lambda module: False)
    said = []
    node = SimpleNamespace(parameters={"lab": True}, get_logger=lambda: SimpleNamespace(error=said.append))
    assert lab_page(node) is None
    assert said == [
        "The lab needs viser, which is not installed. Install it with: pip install viser. The run has no page."
    ]
