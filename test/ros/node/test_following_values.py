"""Parameters of live values that follow other values of the file."""

from pathlib import Path

from rclpy.parameter import Parameter

from test.recordings.runs import stepped_node

FILE = """mechanism: following
parameters: {d: 0.1, k: 2}
parts: {arm: {mass: 1, center: [0, 0, -1]}}
joints: {hip: {type: revolute, between: [ground, arm], axis: [0, 1, 0], damping: d, stiffness: k}}
"""
PARAMETER, DAMPING = "parameters.d", "joints.hip.damping"


def test_a_parameter_of_the_file_moves_the_values_that_follow_it_and_the_node_shows_them(tmp_path: Path) -> None:
    file = tmp_path / "following.yaml"
    file.write_text(FILE, encoding="utf-8")
    with stepped_node(tmp_path, str(file), record=False, **{PARAMETER: 0.2}) as node:

        def shown() -> list[float]:
            return [node.get_parameter(name).value for name in (PARAMETER, DAMPING)]

        assert shown() == [0.2, 0.2] and node.simulation.live[DAMPING] == 0.2
        (result,) = node.set_parameters([Parameter(PARAMETER, value=0.5)])
        assert result.successful, result.reason
        assert shown() == [0.5, 0.5] and node.simulation.live[DAMPING] == 0.5
        node.set_parameters([Parameter(DAMPING, value=0.3)])
        node.set_parameters([Parameter(PARAMETER, value=0.7)])
        assert shown() == [0.7, 0.3] and node.simulation.live[DAMPING] == 0.3
