"""The layouts for Foxglove and PlotJuggler are well-formed, and show topics and fields that the node publishes."""

import json
import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

from mbd_sim.recordings.messages.topics import TOPICS
from mbd_sim.simulation.model.model import Energies

LAUNCH = Path(__file__).resolve().parents[2] / "launch"
NAMES = {topic.name.lstrip("/") for topic in TOPICS}
FIELDS = {"position", "velocity", "effort"}
JOINTS = {"shoulder", "elbow"}  # of double_rod


def test_foxglove_shows_topics_of_the_node():
    layout = json.loads((LAUNCH / "foxglove.json").read_text(encoding="utf-8"))
    panels = layout["configById"]
    paths = [path["value"] for panel in panels.values() for path in panel.get("paths", [])]
    topics = [re.fullmatch(r"/(\w+)\.(position|velocity|effort|data)\[\d\]", path) for path in paths]
    assert len(paths) > 5 and {match[1] for match in topics} <= NAMES
    assert {topic.lstrip("/") for panel in panels.values() for topic in panel.get("topics", {})} <= NAMES
    shown = re.findall(r'"([\w!]+![\w]+)"', json.dumps(layout["layout"]))
    assert sorted(shown) == sorted(panels)


def test_plotjuggler_shows_fields_of_the_node():
    root = ElementTree.parse(LAUNCH / "plotjuggler.xml").getroot()
    names = [curve.get("name").split("/")[1:] for curve in root.iter("curve")]
    assert len(names) > 5
    for topic, entry, field in names:
        assert topic in NAMES and field in FIELDS
        assert entry in (JOINTS if topic == "joint_states" else Energies._fields)
