"""What `sim_node` serves where packages are installed that ROS's wheels do not bring."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import numpy as np
import pytest

from test.ros_interfaces import build
from test.system.nodes import SimNodeProcess, as_in_the_node, nanoseconds, new_domain, running

INSTALLED = build.installed()  # asked before a fixture adds the built packages to the path


@pytest.fixture(scope="module")
def packages(tmp_path_factory: pytest.TempPathFactory) -> Path | None:
    """The folder of the interface packages that `make setup` has built, or that is built now; None if installed."""
    if INSTALLED:
        return None
    if reason := build.missing_tools():
        pytest.skip(reason)
    folder = Path(sys.prefix) / "interfaces"
    if not folder.exists():
        folder = tmp_path_factory.mktemp("interfaces") / "packages"
        build.build(folder)
    return folder


@pytest.fixture
def variables(packages: Path | None, monkeypatch: pytest.MonkeyPatch) -> dict[str, str]:
    """Environment variables with which a node finds the packages; this process finds them, too."""
    if packages is None:
        return {}
    monkeypatch.syspath_prepend(packages)
    return {"PYTHONPATH": os.pathsep.join([str(packages), *filter(None, [os.environ.get("PYTHONPATH")])])}


def test_the_services_of_simulation_interfaces(tmp_path: Path, variables: dict[str, str]) -> None:
    from simulation_interfaces.msg import Result, SimulationState, SimulatorFeatures
    from simulation_interfaces.srv import (
        GetSimulationState,
        GetSimulatorFeatures,
        ResetSimulation,
        SetSimulationState,
        StepSimulation,
    )

    with running(tmp_path, variables=variables, start_paused=True) as (process, listener):

        def state() -> int:
            return int(listener.call(GetSimulationState, "get_simulation_state").state.state)

        def become(wanted: int) -> int:
            request = SimulationState(state=wanted)
            return int(listener.call(SetSimulationState, "set_simulation_state", state=request).result.result)

        features = listener.call(GetSimulatorFeatures, "get_simulator_features").features.features
        assert SimulatorFeatures.STEP_SIMULATION_MULTIPLE in features
        assert state() == SimulationState.STATE_STOPPED
        assert listener.call(StepSimulation, "step_simulation", steps=25).result.result == Result.RESULT_OK
        listener.until(lambda: nanoseconds(listener.states[-1].header.stamp) == 25_000_000, "the state after 25 steps")
        simulation = as_in_the_node("double_rod")
        simulation.step(25)
        assert list(listener.states[-1].position) == simulation.q.tolist()
        assert state() == SimulationState.STATE_PAUSED
        assert become(SimulationState.STATE_PLAYING) == Result.RESULT_OK
        assert become(SimulationState.STATE_PLAYING) == SetSimulationState.Response.ALREADY_IN_TARGET_STATE
        refused = listener.call(StepSimulation, "step_simulation", steps=1).result
        assert refused.result == Result.RESULT_OPERATION_FAILED and "pause" in refused.error_message
        assert become(SimulationState.STATE_STOPPED) == Result.RESULT_OK
        assert state() == SimulationState.STATE_STOPPED
        listener.until(lambda: nanoseconds(listener.states[-1].header.stamp) == 0, "a clock at zero")
        listener.call(StepSimulation, "step_simulation", steps=10)
        scope = ResetSimulation.Request.SCOPE_STATE
        assert listener.call(ResetSimulation, "reset_simulation", scope=scope).result.result == Result.RESULT_OK
        listener.until(lambda: nanoseconds(listener.states[-1].header.stamp) == 10_000_000, "a clock that goes on")
        assert become(SimulationState.STATE_NO_WORLD) == Result.RESULT_FEATURE_UNSUPPORTED
        quitting = SimulationState(state=SimulationState.STATE_QUITTING)
        answer = listener.ask(SetSimulationState, "set_simulation_state", state=quitting)
        listener.until(answer.done, "the answer")
        assert answer.result().result.result == Result.RESULT_OK
        assert process.exit_code() == 0


def test_transforms_of_all_parts(tmp_path: Path, variables: dict[str, str]) -> None:
    from tf2_msgs.msg import TFMessage

    with running(tmp_path, variables=variables, tf=True, frame_prefix="left/") as (_, listener):
        received: list[object] = []
        listener.node.create_subscription(TFMessage, "/tf", received.append, 10)
        listener.until(lambda: received, "/tf")
        simulation = as_in_the_node("double_rod")
        (upper, lower) = received[-1].transforms  # type: ignore[attr-defined]
        simulation.step(nanoseconds(lower.header.stamp) // 1_000_000)
        assert (upper.child_frame_id, lower.header.frame_id) == ("left/upper", "left/ground")
        at = lower.transform.translation
        assert [at.x, at.y, at.z] == simulation.poses()["lower"].position.tolist()


def test_transforms_of_a_free_base_are_published_by_default(tmp_path: Path, variables: dict[str, str]) -> None:
    """Those that robot_state_publisher cannot compute from joint states, and no others."""
    from tf2_msgs.msg import TFMessage

    with running(tmp_path, variables=variables, mechanism="tumbling", frame_prefix="left/") as (_, listener):
        received: list[object] = []
        listener.node.create_subscription(TFMessage, "/tf", received.append, 10)
        listener.until(lambda: received, "/tf")
        simulation = as_in_the_node("tumbling")
        (base,) = received[-1].transforms  # type: ignore[attr-defined]
        simulation.step(nanoseconds(base.header.stamp) // 1_000_000)
        (part,) = simulation.mechanism.parts
        assert (base.header.frame_id, base.child_frame_id) == ("left/ground", f"left/{part}")
        turn = base.transform.rotation
        assert abs(np.dot([turn.w, turn.x, turn.y, turn.z], simulation.q[3:])) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.skipif(INSTALLED, reason="tf2_msgs is installed")
def test_transforms_without_their_package_are_answered_with_its_name(tmp_path: Path) -> None:
    process = SimNodeProcess(new_domain(), tmp_path, {"tf": True})
    try:
        assert process.exit_code() == 1
        assert "tf2_msgs" in process.text and "Traceback" not in process.text
    finally:
        process.kill()
