"""What `sim_node` serves where packages are installed that ROS's wheels do not bring."""

from __future__ import annotations

import math
import os
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from test.ros_interfaces import build
from test.system.growing_recordings import verified
from test.system.nodes import as_in_the_node, nanoseconds, refusal, running

INSTALLED = build.installed()  # asked before a fixture adds the built packages to the path


@pytest.fixture(scope="module")
def packages(tmp_path_factory: pytest.TempPathFactory) -> Path | None:
    """The folder of the interface packages that `make setup` has built, or that is built now; None if installed."""
    if INSTALLED:
        return None
    if reason := build.missing_tools():
        pytest.skip(reason)
    folder = Path(sys.prefix) / "interfaces"
    if not build.is_complete(folder):
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


def test_the_motion_of_a_free_part_is_read_and_set(tmp_path: Path, variables: dict[str, str]) -> None:
    from simulation_interfaces.msg import EntityState, Result, SimulatorFeatures
    from simulation_interfaces.srv import GetEntityState, GetSimulatorFeatures, SetEntityState

    options: dict[str, Any] = {"mechanism": "tumbling", "frame_prefix": "left/", "start_paused": True}
    with running(tmp_path, variables=variables, record=True, record_dir="run", **options) as (process, listener):
        features = listener.call(GetSimulatorFeatures, "get_simulator_features").features.features
        assert {SimulatorFeatures.ENTITY_STATE_GETTING, SimulatorFeatures.ENTITY_STATE_SETTING} <= set(features)
        (part,) = as_in_the_node("tumbling").mechanism.parts

        def get(entity: str = part) -> Any:
            return listener.call(GetEntityState, "get_entity_state", entity=entity)

        def put(entity: str = part, **fields: Any) -> Any:
            return listener.call(SetEntityState, "set_entity_state", entity=entity, **fields).result

        def numbers(vector: Any) -> list[float]:
            return [vector.x, vector.y, vector.z]

        state = EntityState()
        state.pose.position.x, state.pose.orientation.z, state.pose.orientation.w = 1.5, 0.6, 0.8
        state.twist.linear.y, state.twist.angular.z = -2.0, 3.0
        assert put(state=state, set_pose=True, set_twist=True).result == Result.RESULT_OK
        found = get()
        assert found.result.result == Result.RESULT_OK and found.state.header.frame_id == "left/ground"
        assert numbers(found.state.pose.position) == pytest.approx([1.5, 0.0, 0.0], abs=1e-15)
        assert numbers(found.state.pose.orientation) == pytest.approx([0.0, 0.0, 0.6], abs=1e-15)
        assert numbers(found.state.twist.linear) == pytest.approx([0.0, -2.0, 0.0], abs=1e-15)
        assert numbers(found.state.twist.angular) == pytest.approx([0.0, 0.0, 3.0], abs=1e-15)
        moved = EntityState()
        moved.pose.position.z, moved.pose.orientation.w = 7.0, 1.0
        assert put(state=moved, set_pose=True).result == Result.RESULT_OK
        assert numbers(get().state.pose.position) == pytest.approx([0.0, 0.0, 7.0], abs=1e-15)
        assert numbers(get().state.twist.linear) == pytest.approx([0.0, -2.0, 0.0], abs=1e-15)  # in ground's axes

        refused = put("nothing", state=state, set_pose=True)
        assert refused.result == Result.RESULT_NOT_FOUND and part in refused.error_message
        assert get("nothing").result.result == Result.RESULT_NOT_FOUND
        assert put(state=state).result == Result.RESULT_FEATURE_UNSUPPORTED
        state.pose.orientation.w = 0.1
        assert put(state=state, set_pose=True).result == SetEntityState.Response.INVALID_POSE
        state.twist.linear.x = math.nan
        assert put(state=state, set_twist=True).result == Result.RESULT_OPERATION_FAILED
        moved.header.frame_id = "elsewhere"
        assert "'left/ground'" in put(state=moved, set_pose=True).error_message
        assert numbers(get().state.pose.position) == pytest.approx([0.0, 0.0, 7.0], abs=1e-15)
        listener.pause(False)
        seen = len(listener.states)
        listener.until(lambda: len(listener.states) > seen + 20, "states")
        assert process.end() == 0
    verified(tmp_path / "run")


def test_a_part_that_joints_hold_is_read_but_not_set(tmp_path: Path, variables: dict[str, str]) -> None:
    from simulation_interfaces.msg import EntityState, Result
    from simulation_interfaces.srv import GetEntityState, SetEntityState

    with running(tmp_path, variables=variables) as (_, listener):
        found = listener.call(GetEntityState, "get_entity_state", entity="lower")
        assert found.result.result == Result.RESULT_OK
        simulation = as_in_the_node("double_rod")
        simulation.step(nanoseconds(found.state.header.stamp) // 1_000_000)
        at, expected = found.state.pose.position, simulation.poses()["lower"].position
        assert [at.x, at.y, at.z] == pytest.approx(expected.tolist(), abs=1e-12)
        state = EntityState()
        state.pose.orientation.w = 1.0
        refused = listener.call(SetEntityState, "set_entity_state", entity="lower", state=state, set_pose=True).result
        assert refused.result == Result.RESULT_OPERATION_FAILED and "~/set_state" in refused.error_message


SHELF = """
mechanism: shelf
ground: {points: {dock: {at: [1, 2, 3], rotate: {rpy: [0, 0, 90 deg]}}}}
parts:
  board: {mass: 1, inertia: [1, 1, 1], shape: {type: block, size: [2, 1, 0.1]}}
  ball_1: {shape: {type: sphere, radius: 0.2, mass: 3}}
  mark: {mass: 0.1, inertia: [1, 1, 1]}
joints:
  weld: {type: fixed, between: [ground, board]}
  slide: {type: prismatic, between: [ground, ball_1], axis: [0, 0, 1], position: 1.0}
  turn: {type: revolute, between: [ball_1, mark], axis: [0, 0, 1], velocity: 1.0}
"""


def test_entities_their_kinds_and_sizes_and_what_is_refused(tmp_path: Path, variables: dict[str, str]) -> None:
    """Each further service of the standard, of one node: wrong names of services or fields, wrong codes."""
    import simulation_interfaces.srv as services
    from geometry_msgs.msg import Vector3
    from simulation_interfaces.msg import Bounds, EntityCategory, EntityFilters, Result, SimulatorFeatures, TagsFilter

    (tmp_path / "shelf.yaml").write_text(SHELF, encoding="utf-8")
    options: dict[str, Any] = {"mechanism": str(tmp_path / "shelf.yaml"), "start_paused": True}
    with running(tmp_path, variables=variables, **options) as (process, listener):

        def ask(kind: str, name: str, **fields: Any) -> Any:
            return listener.call(getattr(services, kind), name, **fields)

        def entities(**filters: Any) -> Any:
            answer = ask("GetEntities", "get_entities", filters=EntityFilters(**filters))
            return answer.entities if answer.result.result == Result.RESULT_OK else answer.result.result

        features = ask("GetSimulatorFeatures", "get_simulator_features").features.features
        assert SimulatorFeatures.ENTITY_BOUNDS in features
        assert SimulatorFeatures.SPAWNING not in features and SimulatorFeatures.ENTITY_TAGS not in features
        assert entities() == ["board", "ball_1", "mark"]
        assert entities(filter="^b.*[[:digit:]]$") == ["ball_1"]
        static = EntityCategory(category=EntityCategory.CATEGORY_STATIC_OBJECT)
        assert entities(categories=[static]) == ["board"]
        assert entities(tags=TagsFilter(tags=["red"])) == []
        sphere = Bounds(type=Bounds.TYPE_SPHERE, points=[Vector3(x=0.5, z=1.5), Vector3(x=0.42)])
        assert entities(bounds=sphere) == []  # 0.424 from an edge of the ball's box, at (0.2, 0, 1.2)
        sphere.points[1].x = 0.43
        assert entities(bounds=sphere) == ["ball_1"]
        box = Bounds(type=Bounds.TYPE_BOX, points=[Vector3(x=3.0, y=1.0, z=1.0), Vector3(x=0.9, z=0.04)])
        assert entities(bounds=box) == ["board"]
        hull = Bounds(type=Bounds.TYPE_CONVEX_HULL, points=[Vector3()] * 3)
        assert entities(bounds=hull) == Result.RESULT_FEATURE_UNSUPPORTED
        assert entities(filter="(") == entities(filter="(a+)+") == Result.RESULT_OPERATION_FAILED

        info = ask("GetEntityInfo", "get_entity_info", entity="ball_1").info
        assert info.category.category == EntityCategory.CATEGORY_DYNAMIC_OBJECT and "3 kg" in info.description
        bounds = ask("GetEntityBounds", "get_entity_bounds", entity="board").bounds
        assert bounds.type == Bounds.TYPE_BOX
        assert [[p.x, p.y, p.z] for p in bounds.points] == [[1.0, 0.5, 0.05], [-1.0, -0.5, -0.05]]
        assert ask("GetEntityBounds", "get_entity_bounds", entity="mark").bounds.type == Bounds.TYPE_EMPTY
        for kind, name in (("GetEntityInfo", "get_entity_info"), ("GetEntityBounds", "get_entity_bounds")):
            assert ask(kind, name, entity="no").result.result == Result.RESULT_NOT_FOUND
        (dock,) = ask("GetNamedPoses", "get_named_poses").poses
        assert (dock.name, dock.pose.position.y, dock.pose.orientation.z) == ("dock", 2.0, pytest.approx(0.5**0.5))
        world = ask("GetCurrentWorld", "get_current_world").world
        assert world.name == "shelf" and "ball_1:" in world.world_resource.resource_string

        assert ask("StepSimulation", "step_simulation", steps=2000).result.result == Result.RESULT_OK
        answer = ask("GetEntitiesStates", "get_entities_states", filters=EntityFilters(filter="mark|ball"))
        assert answer.entities == ["ball_1", "mark"]
        assert {nanoseconds(one.header.stamp) for one in answer.states} == {2_000_000_000}
        assert answer.states[0].pose.position.z == pytest.approx(1.0 - 0.5 * 9.81 * 4.0, rel=1e-9)
        assert answer.states[1].twist.angular.z == pytest.approx(1.0, rel=1e-9)
        for kind, name in (("DeleteEntity", "delete_entity"), ("LoadWorld", "load_world")):
            refused = ask(kind, name).result
            assert refused.result == Result.RESULT_FEATURE_UNSUPPORTED and refused.error_message, kind
        assert process.end() == 0


def test_steps_by_an_action_with_feedback_that_is_canceled_or_refused(
    tmp_path: Path, variables: dict[str, str]
) -> None:
    """A goal that blocks the node until its end, so that nothing can cancel it; steps without feedback; wrong codes."""
    from rclpy.action import ActionClient
    from rclpy.qos import QoSProfile
    from simulation_interfaces.action import SimulateSteps
    from simulation_interfaces.msg import Result, SimulatorFeatures
    from simulation_interfaces.srv import GetSimulatorFeatures

    succeeded, canceled, aborted = 4, 5, 6  # of action_msgs/GoalStatus
    with running(tmp_path, variables=variables, start_paused=True, publish_rate=10.0) as (process, listener):
        features = listener.call(GetSimulatorFeatures, "get_simulator_features").features.features
        assert SimulatorFeatures.STEP_SIMULATION_ACTION in features
        # What the action's client has not read when the result arrives, it drops: its topic has all of it.
        feedback: list[tuple[int, int]] = []

        def note(message: Any) -> None:
            feedback.append((message.feedback.completed_steps, message.feedback.remaining_steps))

        kind, topic = SimulateSteps.Impl.FeedbackMessage, "sim_node/simulate_steps/_action/feedback"
        subscription = listener.node.create_subscription(kind, topic, note, QoSProfile(depth=1000))
        client = ActionClient(listener.node, SimulateSteps, "sim_node/simulate_steps")
        listener.until(client.server_is_ready, "the action")
        listener.until(lambda: listener.node.count_publishers(topic), "its feedback")
        listener.all_matched()

        def wait(future: Any) -> Any:
            listener.until(future.done, "the answer")
            return future.result()

        def send(steps: int, told: Any = None) -> Any:
            return wait(client.send_goal_async(SimulateSteps.Goal(steps=steps), feedback_callback=told))

        def end(handle: Any) -> tuple[int, int, str]:
            answer = wait(handle.get_result_async())
            return answer.status, answer.result.result.result, answer.result.result.error_message

        assert end(send(60)) == (succeeded, Result.RESULT_OK, "")
        listener.until(lambda: len(feedback) >= 60, "feedback for each step")
        assert feedback == [(done, 60 - done) for done in range(1, 61)]
        listener.node.destroy_subscription(subscription)
        listener.until(lambda: nanoseconds(listener.states[-1].header.stamp) == 60_000_000, "the state after them")
        simulation = as_in_the_node("double_rod")
        simulation.step(60)
        assert list(listener.states[-1].position) == simulation.q.tolist()

        feedback.clear()
        first, waiting = send(10**12, note), send(5)
        listener.until(lambda: feedback, "feedback of the first")
        assert wait(waiting.cancel_goal_async()).goals_canceling
        assert end(waiting) == (canceled, Result.RESULT_OK, "canceled after 0 steps")
        assert wait(first.cancel_goal_async()).goals_canceling
        status, code, text = end(first)
        assert (status, code) == (canceled, Result.RESULT_OK)
        stamp = 1_000_000 * (60 + int(text.split()[2]))
        listener.until(lambda: nanoseconds(listener.states[-1].header.stamp) == stamp, "the state in which it ended")

        status, code, text = end(send(0))
        assert (status, code) == (aborted, Result.RESULT_OPERATION_FAILED) and "no steps" in text
        listener.pause(False)
        status, code, text = end(send(5))
        assert (status, code) == (aborted, Result.RESULT_OPERATION_FAILED) and "pause it" in text
        assert process.end() == 0


def test_inverse_kinematics_by_the_service_of_moveit(tmp_path: Path, variables: dict[str, str]) -> None:
    """Over DDS: answers before others although the search takes long, wrong codes, a run that a search moves or stops."""
    from geometry_msgs.msg import PoseStamped
    from moveit_msgs.msg import MoveItErrorCodes, PositionIKRequest
    from moveit_msgs.srv import GetPositionIK
    from std_srvs.srv import SetBool

    arm = as_in_the_node("double_rod")

    def pose(frame: str = "", **position: float) -> PoseStamped:
        message = PoseStamped()
        message.header.frame_id = frame
        for axis, value in position.items():
            setattr(message.pose.position, axis, value)
        return message

    def request(target: PoseStamped, link: str = "lower.tip", **seed: float) -> dict[str, PositionIKRequest]:
        asked = PositionIKRequest(ik_link_name=link, pose_stamped=target)
        asked.robot_state.joint_state.name = list(seed)
        asked.robot_state.joint_state.position = list(seed.values())
        return {"ik_request": asked}

    with running(tmp_path, variables=variables, frame_prefix="left/", start_paused=True) as (process, listener):
        before = list(listener.states[-1].position)
        slow = listener.ask(GetPositionIK, "compute_ik", **request(pose(x=9.0)))  # starts the process of searches
        assert listener.call(SetBool, "pause", data=True).success and not slow.done()
        bent = {"shoulder": 0.4, "elbow": 0.9}
        arm.reset(q=bent)
        tip = arm.frame("lower.tip")
        (x, _, z), turned = tip.position.tolist(), 0.5 * sum(bent.values())

        def ask(**fields: Any) -> Any:
            return listener.call(GetPositionIK, "compute_ik", **fields)

        def code(**fields: Any) -> int:
            answer = ask(**fields)
            assert answer.error_code.val == 1 or answer.error_code.message
            return int(answer.error_code.val)

        whole = pose(x=x, z=z)
        whole.pose.orientation.y, whole.pose.orientation.w = -math.sin(turned), math.cos(turned)
        answer = ask(**request(whole, "left/lower.tip", shoulder=0.5, elbow=0.7))
        assert answer.error_code.val == MoveItErrorCodes.SUCCESS and answer.error_code.source == "mbd_sim"
        state = answer.solution.joint_state
        assert dict(zip(state.name, state.position, strict=True)) == pytest.approx(bent, abs=1e-8)

        assert slow.done() and slow.result().error_code.val == MoveItErrorCodes.NO_IK_SOLUTION
        assert "out of reach" in slow.result().error_code.message
        assert code(**request(pose(x=x, z=z))) == MoveItErrorCodes.NO_IK_SOLUTION  # not with this orientation
        assert listener.set_parameter("position_only_ik", True).successful
        for elbow in (0.5, -0.5):
            found = ask(**request(pose(x=x, z=z), shoulder=0.0, elbow=elbow)).solution.joint_state.position
            assert found[1] == pytest.approx(math.copysign(bent["elbow"], elbow), abs=1e-7)
        on_upper = ask(**request(pose("left/upper", z=-1.5), shoulder=0.4, elbow=0.9))  # which stays where the seed is
        arm.reset(q=dict(zip(on_upper.solution.joint_state.name, on_upper.solution.joint_state.position, strict=True)))
        assert arm.frame("lower.tip").position == pytest.approx(
            [1.5 * math.sin(0.4), 0.0, -1.5 * math.cos(0.4)], abs=1e-8
        )

        hasty = request(pose(x=9.0), shoulder=1.0)
        hasty["ik_request"].timeout.nanosec = 1
        assert code(**hasty) == MoveItErrorCodes.TIMED_OUT
        for refused, expected in (
            (request(pose(x=x), "lowr"), MoveItErrorCodes.INVALID_LINK_NAME),
            (request(pose("rihgt/ground", x=x)), MoveItErrorCodes.FRAME_TRANSFORM_FAILURE),
            (request(pose(x=math.nan)), MoveItErrorCodes.INVALID_GOAL_CONSTRAINTS),
            (request(pose(x=x), elbw=0.5), MoveItErrorCodes.INVALID_ROBOT_STATE),
        ):
            answer = ask(**refused)
            assert answer.error_code.val == expected and not answer.solution.joint_state.name
        listener.until_paused()
        assert list(listener.states[-1].position) == before
        assert process.end() == 0


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
    assert "tf2_msgs" in refusal(tmp_path, {"tf": True})
