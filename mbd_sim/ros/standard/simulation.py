"""The simulation states of `simulation_interfaces`, its steps and resets, and what of it is not supported."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from functools import partial
from types import ModuleType
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from mbd_sim.files.text.yaml_text import mechanism_text
from mbd_sim.ros.standard.entities import EntityServices
from mbd_sim.ros.standard.messages import fail, installs, serve
from mbd_sim.ros.standard.step_action import serve_step_action
from mbd_sim.ros.stepping.thread import SteppingThread

FEATURES = (
    "SIMULATION_RESET", "SIMULATION_RESET_TIME", "SIMULATION_RESET_STATE",
    "ENTITY_STATE_GETTING", "ENTITY_STATE_SETTING", "ENTITY_INFO_GETTING", "ENTITY_CATEGORIES",
    "ENTITY_BOUNDS", "ENTITY_BOUNDS_BOX", "NAMED_POSES", "WORLD_INFO_GETTING",
    "SIMULATION_STATE_GETTING", "SIMULATION_STATE_SETTING", "SIMULATION_STATE_PAUSE",
    "STEP_SIMULATION_SINGLE", "STEP_SIMULATION_MULTIPLE",
)  # fmt: skip
STEP_ACTION = "STEP_SIMULATION_ACTION"
UNSUPPORTED = {
    **dict.fromkeys(("SpawnEntity", "SpawnEntities", "DeleteEntity"), "the parts are those of the mechanism's file"),
    "GetSpawnables": "nothing can be spawned: the parts are those of the mechanism's file",
    "SetEntityInfo": "kinds and descriptions of parts follow from the mechanism's file",
    "GetNamedPoseBounds": "points of ground have no bounds",
    **dict.fromkeys(
        ("LoadWorld", "UnloadWorld", "GetAvailableWorlds"),
        "a node has one mechanism, that of its parameter 'mechanism': start another node for another one",
    ),
}  # services of the standard, and why they are refused
ANSWER_TIME = 0.5  # s; the answer to STATE_QUITTING is lost where the process ends before the client has read it
MAX_STEPS = 10_000_000  # in one call; the node answers no other request meanwhile


def serve_simulation_interfaces(
    node: Node, stepping_thread: SteppingThread, end: Callable[[], None], frame_prefix: str
) -> SimulationServices | None:
    """Create the services; None, which is logged, if the package is not installed. `end` ends the program."""
    try:
        messages, services = (importlib.import_module(f"simulation_interfaces.{kind}") for kind in ("msg", "srv"))
    except ImportError:
        node.get_logger().info(
            "the services of simulation_interfaces, such as get_entities and reset_simulation, are not served: this "
            "package is not installed. " + installs("simulation_interfaces")
        )
        return None
    EntityServices(node, stepping_thread, messages, services, frame_prefix)
    acts = serve_step_action(node, stepping_thread, messages) is not None
    return SimulationServices(node, stepping_thread, end, messages, services, acts=acts)


class SimulationServices:
    """The standard's simulation states: playing, paused, or stopped, which here is paused at the start state."""

    def __init__(
        self,
        node: Node,
        stepping_thread: SteppingThread,
        end: Callable[[], None],
        messages: ModuleType,
        services: ModuleType,
        *,
        acts: bool,
    ) -> None:
        """:param acts: whether steps are also taken by an action."""
        self._features = (*FEATURES, STEP_ACTION) if acts else FEATURES
        self._node = node
        self._stepping_thread, self._end, self._messages = stepping_thread, end, messages
        self._result, self._states = messages.Result, messages.SimulationState
        self._transition = services.SetSimulationState.Response
        self._scopes = services.ResetSimulation.Request
        self._stopped = True
        for name, callback in (
            ("GetSimulatorFeatures", self._on_get_features),
            ("GetSimulationState", self._on_get_state),
            ("SetSimulationState", self._on_set_state),
            ("ResetSimulation", self._on_reset),
            ("StepSimulation", self._on_step),
            ("GetCurrentWorld", self._on_world),
        ):
            serve(node, services, name, callback)
        for name, reason in UNSUPPORTED.items():
            serve(node, services, name, partial(self._refuse, reason))

    def _refuse(self, reason: str, request: Any, response: Any) -> Any:
        return fail(response, self._result.RESULT_FEATURE_UNSUPPORTED, reason)

    def _on_world(self, request: Any, response: Any) -> Any:
        mechanism = self._stepping_thread.simulation.mechanism
        world = response.world
        world.name, world.description = mechanism.name, mechanism.description or ""
        world.world_resource.resource_string = mechanism_text(mechanism.source)
        return self._succeed(response)

    @property
    def state(self) -> int:
        """The present state."""
        if not self._stepping_thread.paused:
            return int(self._states.STATE_PLAYING)
        stopped = self._stopped and self._stepping_thread.simulation.steps == 0
        return int(self._states.STATE_STOPPED if stopped else self._states.STATE_PAUSED)

    def _on_get_features(self, request: Any, response: Any) -> Any:
        known = self._messages.SimulatorFeatures
        response.features.features = [getattr(known, name) for name in self._features if hasattr(known, name)]
        response.features.custom_info = f"mbd_sim: {self._stepping_thread.simulation.mechanism.name}"
        return response

    def _on_get_state(self, request: Any, response: Any) -> Any:
        response.state.state = self.state
        return self._succeed(response)

    def _on_set_state(self, request: Any, response: Any) -> Any:
        requested, states = request.state.state, self._states
        if requested == self.state:
            return fail(response, self._transition.ALREADY_IN_TARGET_STATE, "already in this state")
        if requested in (states.STATE_PLAYING, states.STATE_PAUSED):
            self._stopped = False
            self._stepping_thread.pause(requested == states.STATE_PAUSED)
        elif requested == states.STATE_STOPPED:
            self._stepping_thread.pause(True)
            if problem := self._stepping_thread.reset(rewind_clock=True):
                return fail(response, self._transition.STATE_TRANSITION_ERROR, problem)
            self._stopped = True
        elif requested == getattr(states, "STATE_QUITTING", None):
            self._node.create_timer(ANSWER_TIME, self._end, clock=Clock(clock_type=ClockType.STEADY_TIME))
        else:
            text = "this state is not supported: the mechanism is always loaded"
            return fail(response, self._result.RESULT_FEATURE_UNSUPPORTED, text)
        return self._succeed(response)

    def _on_reset(self, request: Any, response: Any) -> Any:
        scope = request.scope or self._scopes.SCOPE_ALL
        rewind, state = bool(scope & self._scopes.SCOPE_TIME), bool(scope & self._scopes.SCOPE_STATE)
        if not (rewind or state):
            text = "spawning entities is not supported"
            return fail(response, self._result.RESULT_FEATURE_UNSUPPORTED, text)
        if problem := self._stepping_thread.reset(rewind, state=state):
            return fail(response, self._result.RESULT_OPERATION_FAILED, problem)
        return self._succeed(response)

    def _on_step(self, request: Any, response: Any) -> Any:
        if request.steps > MAX_STEPS:
            text = f"{request.steps} steps are too many for one call: at most {MAX_STEPS}"
            return fail(response, self._result.RESULT_OPERATION_FAILED, text)
        if problem := self._stepping_thread.step(request.steps):
            return fail(response, self._result.RESULT_OPERATION_FAILED, problem)
        return self._succeed(response)

    def _succeed(self, response: Any) -> Any:
        response.result.result = self._result.RESULT_OK
        return response
