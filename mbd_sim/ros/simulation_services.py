"""The services of `simulation_interfaces`, the standard that simulators share, where that package is installed."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from types import ModuleType
from typing import Any

from rclpy.node import Node

from mbd_sim.ros.stepping_thread import Runner

FEATURES = (
    "SIMULATION_RESET", "SIMULATION_RESET_TIME", "SIMULATION_RESET_STATE",
    "SIMULATION_STATE_GETTING", "SIMULATION_STATE_SETTING", "SIMULATION_STATE_PAUSE",
    "STEP_SIMULATION_SINGLE", "STEP_SIMULATION_MULTIPLE",
)  # fmt: skip
MOST_STEPS = 10_000_000  # that one call takes; the node answers nothing else meanwhile


def serve_simulation_interfaces(node: Node, runner: Runner, end: Callable[[], None]) -> SimulationServices | None:
    """Serve them; None where the package is not installed. `end` ends the node."""
    try:
        messages, services = (importlib.import_module(f"simulation_interfaces.{kind}") for kind in ("msg", "srv"))
    except ImportError:
        return None
    return SimulationServices(node, runner, end, messages, services)


class SimulationServices:
    """The state of the simulation as the standard has it: playing, paused, or stopped, which is paused at the start."""

    def __init__(
        self, node: Node, runner: Runner, end: Callable[[], None], messages: ModuleType, services: ModuleType
    ) -> None:
        self._runner, self._end, self._messages = runner, end, messages
        self._result, self._states = messages.Result, messages.SimulationState
        self._transition = services.SetSimulationState.Response
        self._scopes = services.ResetSimulation.Request
        self._stopped = True
        for kind, name, answer in (
            (services.GetSimulatorFeatures, "get_simulator_features", self._features),
            (services.GetSimulationState, "get_simulation_state", self._get_state),
            (services.SetSimulationState, "set_simulation_state", self._set_state),
            (services.ResetSimulation, "reset_simulation", self._reset),
            (services.StepSimulation, "step_simulation", self._step),
        ):
            node.create_service(kind, f"~/{name}", answer)

    @property
    def state(self) -> int:
        """The state now."""
        if not self._runner.paused:
            return int(self._states.STATE_PLAYING)
        stopped = self._stopped and self._runner.simulation.steps == 0
        return int(self._states.STATE_STOPPED if stopped else self._states.STATE_PAUSED)

    def _features(self, request: Any, response: Any) -> Any:
        known = self._messages.SimulatorFeatures
        response.features.features = [getattr(known, name) for name in FEATURES if hasattr(known, name)]
        response.features.custom_info = f"mbd_sim: {self._runner.simulation.mechanism.name}"
        return response

    def _get_state(self, request: Any, response: Any) -> Any:
        response.state.state = self.state
        return self._ok(response)

    def _set_state(self, request: Any, response: Any) -> Any:
        wanted, states = request.state.state, self._states
        if wanted == self.state:
            return self._fail(response, self._transition.ALREADY_IN_TARGET_STATE, "already in this state")
        if wanted == states.STATE_PLAYING:
            self._stopped = False
            self._runner.pause(False)
        elif wanted == states.STATE_PAUSED:
            self._stopped = False
            self._runner.pause(True)
        elif wanted == states.STATE_STOPPED:
            self._runner.pause(True)
            if problem := self._runner.reset(rewind_clock=True):
                return self._fail(response, self._transition.STATE_TRANSITION_ERROR, problem)
            self._stopped = True
        elif wanted == getattr(states, "STATE_QUITTING", None):
            self._end()
        else:
            return self._fail(response, self._result.RESULT_FEATURE_UNSUPPORTED, "there is one mechanism, always there")
        return self._ok(response)

    def _reset(self, request: Any, response: Any) -> Any:
        scope = request.scope or self._scopes.SCOPE_ALL
        rewind, state = bool(scope & self._scopes.SCOPE_TIME), bool(scope & self._scopes.SCOPE_STATE)
        if not (rewind or state):
            return self._fail(response, self._result.RESULT_FEATURE_UNSUPPORTED, "nothing is ever spawned")
        if problem := self._runner.reset(rewind, state=state):
            return self._fail(response, self._result.RESULT_OPERATION_FAILED, problem)
        return self._ok(response)

    def _step(self, request: Any, response: Any) -> Any:
        if request.steps > MOST_STEPS:
            text = f"{request.steps} steps are too many for one call: at most {MOST_STEPS}"
            return self._fail(response, self._result.RESULT_OPERATION_FAILED, text)
        if problem := self._runner.step(request.steps):
            return self._fail(response, self._result.RESULT_OPERATION_FAILED, problem)
        return self._ok(response)

    def _ok(self, response: Any) -> Any:
        response.result.result = self._result.RESULT_OK
        return response

    def _fail(self, response: Any, code: int, text: str) -> Any:
        response.result.result, response.result.error_message = code, text
        return response
