"""The action `simulate_steps`: steps while the run is paused, with feedback, which a client can cancel."""

from __future__ import annotations

import time
from dataclasses import dataclass
from types import ModuleType
from typing import Any

from rclpy.action import ActionServer, CancelResponse
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.task import Future

from mbd_sim.ros.stepping.thread import SteppingThread

ACTION = "simulate_steps"
PERIOD = 0.02  # s between two pieces of work, between which the node answers other requests
WORK = 0.01  # s after which no further piece begins
MOST_WORK = 0.1  # s of a piece, beyond which the next ones are smaller; a loaded machine needs some of it to switch


@dataclass(eq=False)
class _ActiveSteps:
    """A goal that is being executed: its handle, what tells that it has ended, and how far it is."""

    handle: Any
    result: Future
    completed: int = 0


class StepAction:
    """Takes the steps of goals, one goal after another, a piece at a time."""

    def __init__(self, node: Node, stepping_thread: SteppingThread, messages: ModuleType, actions: ModuleType) -> None:
        self._kind, self._codes = actions.SimulateSteps, messages.Result
        self._stepping_thread = stepping_thread
        self._active: list[_ActiveSteps] = []
        self._chunk = 1  # steps in a piece
        self._server = ActionServer(
            node,
            self._kind,
            f"~/{ACTION}",
            self._execute,
            cancel_callback=lambda handle: CancelResponse.ACCEPT,
        )
        node.create_timer(PERIOD, self._continue, clock=Clock(clock_type=ClockType.STEADY_TIME))

    async def _execute(self, handle: Any) -> Any:
        active = _ActiveSteps(handle, Future())
        self._active.append(active)
        return await active.result

    def _continue(self) -> None:
        """Take some more steps of the first goal."""
        if not self._active:
            return
        active = self._active[0]
        handle, steps = active.handle, int(active.handle.request.steps)
        if handle.is_cancel_requested:
            self._end(active, handle.canceled, self._codes.RESULT_OK, f"canceled after {active.completed} steps")
            return
        if not self._stepping_thread.paused:
            text = "the simulation runs: pause it first"
            self._end(active, handle.abort, self._codes.RESULT_OPERATION_FAILED, text)
            return
        until = time.monotonic() + WORK
        while active.completed < steps:
            chunk, begin = min(self._chunk, steps - active.completed), time.monotonic()
            if problem := self._stepping_thread.step(chunk):
                self._end(active, handle.abort, self._codes.RESULT_OPERATION_FAILED, problem)
                return
            active.completed += chunk
            took = time.monotonic() - begin
            if took > MOST_WORK:
                self._chunk = max(1, self._chunk // 2)
            elif took < MOST_WORK / 4:
                self._chunk *= 2
            if time.monotonic() >= until:
                break
        feedback = self._kind.Feedback(completed_steps=active.completed, remaining_steps=steps - active.completed)
        handle.publish_feedback(feedback)
        if active.completed >= steps:
            self._end(active, handle.succeed, self._codes.RESULT_OK, "")

    def _end(self, active: _ActiveSteps, change_state: Any, code: int, text: str) -> None:
        """End a goal; whoever waits for its result gets it even if the change of its state could not be published."""
        self._active.remove(active)
        try:
            change_state()
        finally:
            active.result.set_result(self._kind.Result(result=self._codes(result=code, error_message=text)))
