"""The services of `sim_node`: its own, which control a run, and those of `simulation_interfaces`.

Its own services pause, step and reset, and make recordings. `simulation_interfaces` is a standard shared by simulators,
whose services exist if that package is installed; its entities are the parts of the mechanism.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from types import ModuleType
from typing import Any

import numpy as np
from geometry_msgs.msg import Accel, Point, Quaternion, Twist, Vector3
from geometry_msgs.msg import Pose as PoseMessage
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.time import Time
from std_msgs.msg import Header
from std_srvs.srv import SetBool, Trigger

from mbd_sim.base.errors import nearest, quoted
from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.base.geometry.rotation import from_quaternion, to_quaternion
from mbd_sim.mechanism.elements.parts import GROUND
from mbd_sim.ros.node.parameters import NodeParameters
from mbd_sim.ros.publishing.recordings import NodeRecordings
from mbd_sim.ros.stepping.thread import SteppingThread
from mbd_sim.simulation.model.state_records import PartMotion
from mbd_sim.simulation.run.changes import StateValues
from mbd_sim.simulation.run.moving_points import free_joint_of, free_joint_values

SERVICES = (
    ("~/pause", "std_srvs/srv/SetBool: pause (true) or resume"),
    ("~/step", "std_srvs/srv/Trigger: take step_count steps while paused"),
    ("~/reset", "std_srvs/srv/Trigger: return to the start state, or to the one that the parameter start gives"),
    ("~/record", "std_srvs/srv/SetBool: start (true) or stop a recording"),
    ("~/split_recording", "std_srvs/srv/Trigger: continue the recording in another file"),
)


class RunServices:
    """Serves them; `on_recording` is called when a recording has been started."""

    def __init__(
        self,
        node: Node,
        stepping_thread: SteppingThread,
        parameters: NodeParameters,
        recordings: NodeRecordings,
        on_recording: Callable[[], None],
    ) -> None:
        self._stepping_thread, self._parameters, self._recordings = stepping_thread, parameters, recordings
        self._log, self._on_recording = node.get_logger(), on_recording
        node.create_service(Trigger, "~/reset", self._on_reset)
        node.create_service(SetBool, "~/pause", self._on_pause)
        node.create_service(Trigger, "~/step", self._on_step)
        node.create_service(SetBool, "~/record", self._on_record)
        node.create_service(Trigger, "~/split_recording", self._on_split_recording)

    def _on_reset(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        problem = self._stepping_thread.reset(self._parameters["reset_rewinds_clock"])
        response.success, response.message = not problem, problem or "reset to the start state"
        return response

    def _on_pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        self._stepping_thread.pause(request.data)
        response.success, response.message = True, "paused" if request.data else "running"
        return response

    def _on_step(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        problem = self._stepping_thread.step(self._parameters["step_count"])
        response.success = not problem
        response.message = problem or f"t = {1e-9 * self._stepping_thread.clock.ns:.9g} s"
        return response

    def record(self, on: bool) -> tuple[bool, str]:
        """Start or stop a recording; returns success, and its path or the reason."""
        if on:
            done, answer = self._recordings.start()
            self._on_recording()
        else:
            done, answer = self._recordings.stop()
        if done:
            self._log.info(f"recording to {answer}" if on else self._recordings.summary())
        return done, answer

    def _on_record(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        response.success, response.message = self.record(request.data)
        return response

    def _on_split_recording(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success, response.message = self._recordings.split()
        return response


UNIT_NORM = 1e-3  # by how much the norm of a given quaternion may differ from 1
FLAGS = ("set_pose", "set_twist")  # of a request; simulation_interfaces 1 has none, and sets both


class EntityServices:
    """Reads the motion of any part, and sets that of parts which move freely."""

    def __init__(
        self, node: Node, stepping_thread: SteppingThread, messages: ModuleType, services: ModuleType, frame_prefix: str
    ) -> None:
        self._stepping_thread, self._model = stepping_thread, stepping_thread.simulation.model
        self._result, self._ground = messages.Result, frame_prefix + GROUND
        self._invalid_pose = getattr(
            services.SetEntityState.Response, "INVALID_POSE", messages.Result.RESULT_OPERATION_FAILED
        )
        node.create_service(services.GetEntityState, "~/get_entity_state", self._on_get)
        node.create_service(services.SetEntityState, "~/set_entity_state", self._on_set)

    def _on_get(self, request: Any, response: Any) -> Any:
        if problem := self._unknown(request.entity):
            return _fail(response, self._result.RESULT_NOT_FOUND, problem)
        self._prepare()
        found = list[tuple[int, Mapping[str, PartMotion]]]()

        def read() -> str:
            found.append((self._stepping_thread.clock.ns, self._now()))
            return ""

        if problem := self._stepping_thread.between_steps(read):
            return _fail(response, self._result.RESULT_OPERATION_FAILED, problem)
        time_ns, motion = found[0][0], found[0][1][request.entity]
        state, (w, x, y, z) = response.state, to_quaternion(motion.pose.rotation).tolist()
        state.header = Header(stamp=Time(nanoseconds=time_ns).to_msg(), frame_id=self._ground)
        state.pose = PoseMessage(
            position=_filled(Point(), motion.pose.position), orientation=Quaternion(w=w, x=x, y=y, z=z)
        )
        state.twist = Twist(
            linear=_filled(Vector3(), motion.velocity), angular=_filled(Vector3(), motion.angular_velocity)
        )
        state.acceleration = Accel(
            linear=_filled(Vector3(), motion.acceleration), angular=_filled(Vector3(), motion.angular_acceleration)
        )
        response.result.result = self._result.RESULT_OK
        return response

    def _on_set(self, request: Any, response: Any) -> Any:
        part, state, result = request.entity, request.state, self._result
        if problem := self._unknown(part):
            return _fail(response, result.RESULT_NOT_FOUND, problem)
        joint = free_joint_of(self._model, part)
        if joint is None:
            text = f"part '{part}' does not move freely: its joints determine its pose. Set them on ~/set_state."
            return _fail(response, result.RESULT_OPERATION_FAILED, text)
        if state.header.frame_id not in ("", GROUND, self._ground):
            text = f"the frame {quoted(state.header.frame_id)} is not known. Use '{self._ground}', or leave it empty."
            return _fail(response, result.RESULT_OPERATION_FAILED, text)
        sets_pose, sets_twist = (getattr(request, flag, True) for flag in FLAGS)
        if not (sets_pose or sets_twist):
            text = "it sets neither pose nor twist; an acceleration follows from the forces"
            return _fail(response, result.RESULT_FEATURE_UNSUPPORTED, text)
        pose = _pose(state.pose)
        velocity, angular_velocity = _array(state.twist.linear), _array(state.twist.angular)
        if sets_pose and pose is None:
            text = "the pose is not valid. Give finite numbers, and a quaternion of norm 1."
            return _fail(response, self._invalid_pose, text)
        if sets_twist and not np.all(np.isfinite([velocity, angular_velocity])):
            return _fail(response, result.RESULT_OPERATION_FAILED, "the twist is not finite. Give finite numbers.")
        self._prepare()

        def values() -> StateValues:
            now = self._now()
            motion = now[part]
            if sets_pose and pose is not None:
                motion = motion._replace(pose=pose)
            if sets_twist:
                motion = motion._replace(velocity=velocity, angular_velocity=angular_velocity)
            return StateValues(*free_joint_values(self._model, joint, {**now, part: motion}))

        if problem := self._stepping_thread.set_state(values):
            return _fail(response, result.RESULT_OPERATION_FAILED, problem)
        response.result.result = result.RESULT_OK
        return response

    def _prepare(self) -> None:
        """Compile what computes the motions, at the first request and outside the stepping thread."""
        self._model.part_motions(0.0, self._model.start, self._model.inputs)

    def _now(self) -> Mapping[str, PartMotion]:
        """The motions of all parts, for the stepping thread."""
        simulation = self._stepping_thread.simulation
        return self._model.part_motions(simulation.time, simulation.y, simulation.inputs)

    def _unknown(self, part: str) -> str:
        if part in self._model.part_names:
            return ""
        return f"there is no part {quoted(part)}. {nearest(part, self._model.part_names)}".strip()


def _fail(response: Any, code: int, text: str) -> Any:
    response.result.result, response.result.error_message = code, text
    return response


def _filled(message: Any, values: Array) -> Any:
    message.x, message.y, message.z = values.tolist()
    return message


def _array(vector: Any) -> Array:
    return np.array([vector.x, vector.y, vector.z])


def _pose(message: Any) -> Pose | None:
    """The pose of a message; None if a number is not finite or the quaternion not a unit one."""
    position, q = _array(message.position), message.orientation
    quaternion = np.array([q.w, q.x, q.y, q.z])
    norm = float(np.linalg.norm(quaternion))
    if not (np.all(np.isfinite(position)) and np.isfinite(norm) and abs(norm - 1.0) <= UNIT_NORM):
        return None
    return Pose(position, from_quaternion(quaternion / norm))


FEATURES = (
    "SIMULATION_RESET", "SIMULATION_RESET_TIME", "SIMULATION_RESET_STATE",
    "ENTITY_STATE_GETTING", "ENTITY_STATE_SETTING",
    "SIMULATION_STATE_GETTING", "SIMULATION_STATE_SETTING", "SIMULATION_STATE_PAUSE",
    "STEP_SIMULATION_SINGLE", "STEP_SIMULATION_MULTIPLE",
)  # fmt: skip
ANSWER_TIME = 0.5  # s; the answer to STATE_QUITTING is lost where the process ends before the client has read it
MAX_STEPS = 10_000_000  # in one call; the node answers no other request meanwhile


def serve_simulation_interfaces(
    node: Node, stepping_thread: SteppingThread, end: Callable[[], None], frame_prefix: str
) -> SimulationServices | None:
    """Create the services; None if the package is not installed. `end` ends the program."""
    try:
        messages, services = (importlib.import_module(f"simulation_interfaces.{kind}") for kind in ("msg", "srv"))
    except ImportError:
        return None
    EntityServices(node, stepping_thread, messages, services, frame_prefix)
    return SimulationServices(node, stepping_thread, end, messages, services)


class SimulationServices:
    """The standard's simulation states: playing, paused, or stopped, which here is paused at the start state."""

    def __init__(
        self,
        node: Node,
        stepping_thread: SteppingThread,
        end: Callable[[], None],
        messages: ModuleType,
        services: ModuleType,
    ) -> None:
        self._node = node
        self._stepping_thread, self._end, self._messages = stepping_thread, end, messages
        self._result, self._states = messages.Result, messages.SimulationState
        self._transition = services.SetSimulationState.Response
        self._scopes = services.ResetSimulation.Request
        self._stopped = True
        for service_type, name, callback in (
            (services.GetSimulatorFeatures, "get_simulator_features", self._on_get_features),
            (services.GetSimulationState, "get_simulation_state", self._on_get_state),
            (services.SetSimulationState, "set_simulation_state", self._on_set_state),
            (services.ResetSimulation, "reset_simulation", self._on_reset),
            (services.StepSimulation, "step_simulation", self._on_step),
        ):
            node.create_service(service_type, f"~/{name}", callback)

    @property
    def state(self) -> int:
        """The present state."""
        if not self._stepping_thread.paused:
            return int(self._states.STATE_PLAYING)
        stopped = self._stopped and self._stepping_thread.simulation.steps == 0
        return int(self._states.STATE_STOPPED if stopped else self._states.STATE_PAUSED)

    def _on_get_features(self, request: Any, response: Any) -> Any:
        known = self._messages.SimulatorFeatures
        response.features.features = [getattr(known, name) for name in FEATURES if hasattr(known, name)]
        response.features.custom_info = f"mbd_sim: {self._stepping_thread.simulation.mechanism.name}"
        return response

    def _on_get_state(self, request: Any, response: Any) -> Any:
        response.state.state = self.state
        return self._succeed(response)

    def _on_set_state(self, request: Any, response: Any) -> Any:
        requested, states = request.state.state, self._states
        if requested == self.state:
            return _fail(response, self._transition.ALREADY_IN_TARGET_STATE, "already in this state")
        if requested in (states.STATE_PLAYING, states.STATE_PAUSED):
            self._stopped = False
            self._stepping_thread.pause(requested == states.STATE_PAUSED)
        elif requested == states.STATE_STOPPED:
            self._stepping_thread.pause(True)
            if problem := self._stepping_thread.reset(rewind_clock=True):
                return _fail(response, self._transition.STATE_TRANSITION_ERROR, problem)
            self._stopped = True
        elif requested == getattr(states, "STATE_QUITTING", None):
            self._node.create_timer(ANSWER_TIME, self._end, clock=Clock(clock_type=ClockType.STEADY_TIME))
        else:
            text = "this state is not supported: the mechanism is always loaded"
            return _fail(response, self._result.RESULT_FEATURE_UNSUPPORTED, text)
        return self._succeed(response)

    def _on_reset(self, request: Any, response: Any) -> Any:
        scope = request.scope or self._scopes.SCOPE_ALL
        rewind, state = bool(scope & self._scopes.SCOPE_TIME), bool(scope & self._scopes.SCOPE_STATE)
        if not (rewind or state):
            text = "spawning entities is not supported"
            return _fail(response, self._result.RESULT_FEATURE_UNSUPPORTED, text)
        if problem := self._stepping_thread.reset(rewind, state=state):
            return _fail(response, self._result.RESULT_OPERATION_FAILED, problem)
        return self._succeed(response)

    def _on_step(self, request: Any, response: Any) -> Any:
        if request.steps > MAX_STEPS:
            text = f"{request.steps} steps are too many for one call: at most {MAX_STEPS}"
            return _fail(response, self._result.RESULT_OPERATION_FAILED, text)
        if problem := self._stepping_thread.step(request.steps):
            return _fail(response, self._result.RESULT_OPERATION_FAILED, problem)
        return self._succeed(response)

    def _succeed(self, response: Any) -> Any:
        response.result.result = self._result.RESULT_OK
        return response
