"""The services of `sim_node` that are its own: they pause, step and reset a run, and make recordings."""

from __future__ import annotations

from collections.abc import Callable

from rclpy.node import Node
from std_srvs.srv import SetBool, Trigger

from mbd_sim.ros.node.parameters import NodeParameters
from mbd_sim.ros.publishing.recordings import NodeRecordings
from mbd_sim.ros.publishing.ring import NodeRing
from mbd_sim.ros.stepping.thread import SteppingThread

SERVICES = (
    ("~/pause", "std_srvs/srv/SetBool: pause (true) or resume"),
    ("~/step", "std_srvs/srv/Trigger: take step_count steps while paused"),
    ("~/reset", "std_srvs/srv/Trigger: return to the start state, or to the one that the parameter start gives"),
    ("~/record", "std_srvs/srv/SetBool: start (true) or stop a recording"),
    ("~/split_recording", "std_srvs/srv/Trigger: continue the recording in another file"),
    ("~/record_last", "std_srvs/srv/Trigger: write the last seconds, which the parameter record_last keeps"),
)


class RunServices:
    """Serves them; `on_recording` is called when a recording has been started."""

    def __init__(
        self,
        node: Node,
        stepping_thread: SteppingThread,
        parameters: NodeParameters,
        recordings: NodeRecordings,
        ring: NodeRing | None,
        on_recording: Callable[[], None],
    ) -> None:
        self._stepping_thread, self._parameters, self._recordings = stepping_thread, parameters, recordings
        self._log, self._ring, self._on_recording = node.get_logger(), ring, on_recording
        node.create_service(Trigger, "~/reset", self._on_reset)
        node.create_service(SetBool, "~/pause", self._on_pause)
        node.create_service(Trigger, "~/step", self._on_step)
        node.create_service(SetBool, "~/record", self._on_record)
        node.create_service(Trigger, "~/split_recording", self._on_split_recording)
        node.create_service(Trigger, "~/record_last", self._on_record_last)

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

    def _on_record_last(self, request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self._ring is None:
            response.message = "nothing is kept: start the node with record_last, the number of seconds"
        else:
            response.success, response.message = self._ring.write()
        return response
