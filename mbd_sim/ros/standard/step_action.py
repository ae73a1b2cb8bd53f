"""The action `~/simulate_steps`: steps while the run is paused, with feedback after each, which a client can cancel."""

from __future__ import annotations

import importlib
import time
from collections.abc import Generator
from dataclasses import dataclass, field
from types import ModuleType
from typing import Any

from rclpy.action import ActionServer, CancelResponse
from rclpy.node import Node
from rclpy.qos import QoSProfile

from mbd_sim.base.errors import counted
from mbd_sim.ros.stepping.thread import SteppingThread

ACTION = "~/simulate_steps"
WORK = 0.015  # s of steps and their feedback in a piece, after which the node serves other requests
BURST, RATE = 200, 500.0  # feedback for each step of a goal at first, and most of it in a second then: DDS loses more
FEEDBACK = QoSProfile(depth=BURST)


def serve_step_action(node: Node, stepping_thread: SteppingThread, messages: ModuleType) -> StepAction | None:
    """Serve the action; None if the installed package has none."""
    try:
        actions = importlib.import_module("simulation_interfaces.action")
    except ImportError:
        return None
    return StepAction(node, stepping_thread, messages, actions)


class _NextTurn:
    """Awaited by a coroutine that the executor is to continue after what else has arrived."""

    def __await__(self) -> Generator[None]:
        yield


@dataclass
class _StepProgress:
    """How far a goal is."""

    steps: int
    completed: int = 0
    told: int = 0
    began: float = field(default_factory=time.monotonic)

    @property
    def left(self) -> int:
        """The steps that have not been taken."""
        return self.steps - self.completed

    def advance(self, now: float) -> bool:
        """Take that a step has been completed; returns whether to tell the client."""
        self.completed += 1
        tells = not self.left or self.told < BURST + RATE * (now - self.began)
        self.told += tells
        return tells


class StepAction:
    """Takes the steps of goals, one goal after another, a piece at a time.

    A goal is a coroutine of the executor, which serves what else has arrived between two pieces: with all steps in one
    callback, a goal could not be canceled, and with a timer, a piece that takes longer than its period, as on a busy
    machine, would be followed by the next one, and no other request would be served.
    """

    def __init__(self, node: Node, stepping_thread: SteppingThread, messages: ModuleType, actions: ModuleType) -> None:
        self._kind, self._codes = actions.SimulateSteps, messages.Result
        self._stepping_thread = stepping_thread
        self._goals: list[Any] = []  # handles, in the order in which they came
        self._server = ActionServer(
            node,
            self._kind,
            ACTION,
            self._execute,
            cancel_callback=lambda handle: CancelResponse.ACCEPT,
            feedback_pub_qos_profile=FEEDBACK,
        )

    async def _execute(self, handle: Any) -> Any:
        self._goals.append(handle)
        try:
            code, text = await self._take_steps(handle)
        finally:
            self._goals.remove(handle)
        return self._kind.Result(result=self._codes(result=code, error_message=text))

    async def _take_steps(self, handle: Any) -> tuple[int, str]:
        """Take the steps of a goal, and end it; returns the code and the text of its result."""
        if not handle.request.steps:
            handle.abort()
            return self._codes.RESULT_OPERATION_FAILED, "no steps: give one or more"
        progress = _StepProgress(int(handle.request.steps))
        while progress.left:
            if handle.is_cancel_requested:
                self._stepping_thread.step(0)  # publishes the state in which the goal ends
                handle.canceled()
                return self._codes.RESULT_OK, f"canceled after {counted(progress.completed, 'step')}"
            if handle is self._goals[0] and (problem := self._take_piece(handle, progress)):
                handle.abort()
                return self._codes.RESULT_OPERATION_FAILED, problem
            await _NextTurn()
        handle.succeed()
        return self._codes.RESULT_OK, ""

    def _take_piece(self, handle: Any, progress: _StepProgress) -> str:
        """Take some more steps of a goal; returns the problem, or ""."""
        until = time.monotonic() + WORK

        def each() -> bool:
            now = time.monotonic()
            if progress.advance(now):
                feedback = self._kind.Feedback(completed_steps=progress.completed, remaining_steps=progress.left)
                handle.publish_feedback(feedback)
            return now < until

        return self._stepping_thread.step(progress.left, each)
