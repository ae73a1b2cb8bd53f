"""Generated layouts are those of their programs' format, and name what the node publishes."""

import json
import re
import xml.etree.ElementTree as ElementTree

import pytest

from mbd_sim import InputError, load_mechanism
from mbd_sim.cli.main import main
from mbd_sim.recordings.views.layouts import layout


@pytest.mark.parametrize("name", ["slider_crank", "stewart", "balancing_pendulum"])
def test_all_joints_are_shown_where_they_are(name):
    mechanism = load_mechanism(name)
    order = [*mechanism.coordinate_names, *mechanism.driven_names]
    panels = json.loads(layout(mechanism, ".json"))
    paths = [path for panel in panels["configById"].values() for path in panel.get("paths", [])]
    positions = {path["label"]: path["value"] for path in paths if ".position[" in path["value"]}
    assert positions == {one: f"/joint_states.position[{index}]" for index, one in enumerate(order)}
    shown = re.findall(r'"([\w]+![\w]+)"', json.dumps(panels["layout"]))
    assert sorted(shown) == sorted(panels["configById"])
    root = ElementTree.fromstring(layout(mechanism, ".xml"))
    curves = {curve.get("name") for curve in root.iter("curve")}
    assert {f"/joint_states/{one}/position" for one in order} <= curves and "/energy_values/residual/position" in curves
    sizes = [float(size) for split in root.iter("DockSplitter") for size in split.get("sizes").split(";")]
    assert sum(sizes) == pytest.approx(1.0, abs=1e-4) and len(sizes) == len(list(root.iter("plot")))


def test_sensors_and_namespaces():
    text = layout(load_mechanism("balancing_pendulum"), ".json", "/left", "plant")
    assert '"/left/joint_states.position[0]"' in text and "/left/plant/sensors/" in text and "sim_node" not in text


def test_other_files_are_refused(tmp_path, capsys):
    with pytest.raises(InputError, match="no layout"):
        layout(load_mechanism("slider_crank"), ".yaml")
    assert main(["layout", "slider_crank", "--out", str(tmp_path / "a.txt")]) == 1
    assert ".json, .xml" in capsys.readouterr().err
