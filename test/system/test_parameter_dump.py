"""`ros2 param load` of a node's own `ros2 param dump`, by rclpy's own reader of such files."""

from pathlib import Path
from typing import Any

import pytest
import yaml
from rcl_interfaces.srv import GetParameters, ListParameters, SetParameters
from rclpy.parameter import Parameter, parameter_dict_from_yaml_file, parameter_value_to_python

from mbd_sim.ros.node.sim_parameters import PARAMETERS
from test.system.nodes import Listener, running

GIVEN = {
    "wrenches": "'*'",
    "part_poses": "'*'",
    "live": "'*'",
    "record_dir": "'2024'",
    "gravity": "[0, 0, -10]",
    "joints.elbow.damping": "1.0e-5",
    "starts.high": "elbow = 10 deg",
    "publish_rate": "50",
}


def dump(listener: Listener) -> dict[str, Any]:
    """What `ros2 param dump` writes."""
    names = sorted(listener.call(ListParameters, "list_parameters").result.names)
    found = listener.call(GetParameters, "get_parameters", names=names).values
    nested: dict[str, Any] = {}
    for name, value in zip(names, found, strict=True):
        *groups, last = name.split(".")
        inner = nested
        for group in groups:
            inner = inner.setdefault(group, {})
        inner[last] = parameter_value_to_python(value)
    return nested


def load(listener: Listener, path: Path, content: dict[str, Any]) -> dict[str, str]:
    """What `ros2 param load` does. Returns the names, each with the reason of the refusal, empty for success."""
    path.write_text(yaml.dump({"/sim_node": {"ros__parameters": content}}, default_flow_style=False))
    parameters = list(parameter_dict_from_yaml_file(str(path), True, ["/sim_node"]).values())
    results = listener.call(SetParameters, "set_parameters", parameters=parameters).results
    assert len(results) == len(parameters)
    return {
        parameter.name: "" if result.successful else result.reason
        for parameter, result in zip(parameters, results, strict=True)
    }


def test_a_node_takes_its_own_dump_and_what_was_edited_in_it(tmp_path: Path) -> None:
    with running(tmp_path, **GIVEN) as (_, listener):
        content = dump(listener)
        answers = load(listener, tmp_path / "dump.yaml", content)
        assert {spec.name for spec in PARAMETERS} <= set(answers)
        assert {"joints.elbow.damping", "starts.high", "use_sim_time", "gravity"} <= set(answers)
        assert {name: reason for name, reason in answers.items() if reason} == {}
        assert dump(listener) == content
        assert [content["wrenches"], content["part_poses"], content["live"]] == ["all"] * 3
        assert not any("live values" in text for text in listener.events)  # nothing has changed

        content["gravity"] = [1e-5, 0.0, -9.5]
        content["joints"]["elbow"]["damping"] = 2e-5
        content |= {"publish_rate": 20, "start": "high", "mechanism": "four_bar", "record_dir": "2025"}
        content |= {"step_count": 2.5, "marker_rate": -1.0, "use_sim_time": True}
        answers = load(listener, tmp_path / "edited.yaml", content)
        refused = {name: reason for name, reason in answers.items() if reason}
        assert refused.pop("step_count").startswith("Wrong parameter type")  # rclpy's words, which differ by version
        assert refused == {
            "mechanism": "parameter 'mechanism' is read-only: set it when starting the node",
            "record_dir": "parameter 'record_dir' is read-only: set it when starting the node",
            "marker_rate": "Parameter marker_rate out of range Min: 0.0, Max: 1000.0, value: -1.0",
            "use_sim_time": "set use_sim_time when starting the node: it decides whose clock the node follows.",
        }
        found = dump(listener)
        assert found["gravity"] == [1e-5, 0.0, -9.5]
        assert found["joints"]["elbow"]["damping"] == 2e-5
        assert [found["publish_rate"], found["start"]] == [20, "high"]


@pytest.mark.parametrize("text", ["[0.0, true, 1e-5]", "[]", "one", "[" * 5000, "1e999"])
def test_a_string_that_is_no_number_is_refused_where_a_number_is_due(shared_node: Listener, text: str) -> None:
    before = shared_node.parameter("gravity")
    message = Parameter("gravity", value=text).to_parameter_msg()
    (result,) = shared_node.call(SetParameters, "set_parameters", parameters=[message]).results
    assert not result.successful and "gravity" in result.reason
    assert shared_node.parameter("gravity") == before


@pytest.fixture(scope="module")
def shared_node(tmp_path_factory: pytest.TempPathFactory) -> Any:
    with running(tmp_path_factory.mktemp("node")) as (_, listener):
        yield listener
