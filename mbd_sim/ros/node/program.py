"""A node as a program, from the command line to the exit code; `sim_node`, `replay_node` and the examples use it.

Nothing that arrives over DDS can make its callbacks fail: errors are answered and reported, and the node continues.
Otherwise rclpy ends the executor with the exception of a callback, also with those of its own parameter services, such
as that of a parameter whose type does not exist.
"""

from __future__ import annotations

import queue
import signal
import sys
import threading
import time
from collections.abc import Callable, Sequence
from functools import wraps
from itertools import takewhile
from types import FrameType
from typing import Any, Protocol

import rclpy
from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from mbd_sim.base.errors import MbdSimError, quoted
from mbd_sim.base.interrupts import raise_interrupt
from mbd_sim.ros.events_executor import EventsExecutor
from mbd_sim.ros.node.parameters import Service, set_one_at_a_time
from mbd_sim.ros.stepping import realtime

REPORT_PERIOD = 1.0  # s between reports


class CallbackWatch:
    """Watches the callbacks of a node; `failures` counts the messages and requests that one could not process."""

    def __init__(self, node: Node) -> None:
        self.failures = 0
        self._node, self._log = node, node.get_logger()
        self._watched: set[int] = set()
        self._last_report = -REPORT_PERIOD

    def watch(self) -> None:
        """Watch all subscriptions, services and timers that the node has now."""
        for subscription in self._new(self._node.subscriptions):
            subscription.callback = self._watched_message(
                subscription.callback, f"message on {subscription.topic_name}"
            )
        for timer in self._new(self._node.timers):
            timer.callback = self._watched_message(timer.callback, "timer")
        for service in self._new(self._node.services):
            callback = service.callback
            if service.srv_type is SetParameters:
                callback = set_one_at_a_time(self._node, callback, _reason)
            service.callback = self._watched_service(callback, service)

    def report(self, what: str, error: Exception) -> None:
        """Count a failure, and log it if none was logged in the last second."""
        self.failures += 1
        now = time.monotonic()
        if now - self._last_report >= REPORT_PERIOD:
            self._last_report = now
            self._log.error(f"{what} not processed ({self.failures} failures so far): {_reason(error)}")

    def _new(self, entities: Any) -> list[Any]:
        found = [entity for entity in entities if id(entity) not in self._watched]
        self._watched.update(map(id, found))
        return found

    def _watched_message(self, callback: Callable[..., None], what: str) -> Callable[..., None]:
        @wraps(callback)
        def watched(*arguments: Any) -> None:
            try:
                callback(*arguments)
            except Exception as error:
                self.report(what, error)

        return watched

    def _watched_service(self, callback: Service, service: Any) -> Service:
        @wraps(callback)
        def watched(request: Any, response: Any) -> Any:
            try:
                return callback(request, response)
            except Exception as error:
                self.report(f"request of {service.service_name}", error)
                return _refusal(service.srv_type, _reason(error))

        return watched


def _refusal(service_type: Any, reason: str) -> Any:
    """The response of a service that says, as far as its type allows, that the request was refused."""
    response = service_type.Response()
    if service_type is SetParametersAtomically:
        response.result = SetParametersResult(successful=False, reason=reason)
    elif hasattr(response, "success") and hasattr(response, "message"):
        response.success, response.message = False, reason
    return response


def _reason(error: Exception) -> str:
    return quoted(f"{type(error).__name__}: {error}", max_length=300)


# Errors that a user causes by a parameter, a file or a missing package: reported without a traceback.
USER_ERRORS = (
    MbdSimError, ValueError, ImportError, InvalidParameterTypeException, InvalidParameterValueException,
)  # fmt: skip
JOIN_TIMEOUT = 2.0  # s, for the end of the executor's thread


class ProgramNode(Protocol):
    """A node that `run_node` can run; it is also an `rclpy.node.Node`."""

    def start(self) -> None:
        """Begin to work; the executor spins already."""

    def stop(self) -> None:
        """End the work and release resources; the executor spins no longer."""


def run_node(
    name: str,
    make_node: Callable[[Callable[[], None]], ProgramNode],
    arguments: Sequence[str] | None = None,
    *,
    example: str,
    help_text: Callable[[], str],
) -> int:
    """Run a node until SIGINT or SIGTERM, or until it ends itself; returns the exit code.

    A signal while the node is being built ends the program at once; a further signal while the node ends changes
    nothing.

    :param make_node: builds the node; its argument is a function that ends the program.
    :param arguments: words after the program's name; by default those of the command line.
    :param example: a parameter for the usage line, such as `mechanism:=double_rod`.
    :param help_text: returns what `--help` prints.
    """
    try:
        return _run(name, make_node, arguments, example, help_text)
    except KeyboardInterrupt:  # while the node was being built
        return 0


def _run(
    name: str,
    make_node: Callable[[Callable[[], None]], ProgramNode],
    arguments: Sequence[str] | None,
    example: str,
    help_text: Callable[[], str],
) -> int:
    ended = threading.Event()
    end_requests: queue.SimpleQueue[int] = queue.SimpleQueue()  # signals, and 0 for a request of the node itself

    def interrupt(received: int, frame: FrameType | None) -> None:
        """End the building, or else the run, if a library drops the exception."""
        end_requests.put(received)
        raise_interrupt(frame)

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, interrupt)
    usage = f"Parameters follow --ros-args, each after -p: {name} --ros-args -p {example}"
    words = sys.argv[1:] if arguments is None else list(arguments)
    if {"--help", "-h"} & set(words):
        print(help_text())
        return 0
    # rclpy ignores arguments before --ros-args: `-p mechanism:=x` alone would run another mechanism.
    if ignored := list(takewhile(lambda word: word != "--ros-args", words)):
        return _fail(name, f"arguments not understood: {' '.join(ignored)}. {usage}")
    try:
        rclpy.init(args=words, signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:  # rclpy exports no class for arguments that it cannot parse
        return _fail(name, f"{error}\n{usage}")
    try:
        try:
            node = make_node(lambda: end_requests.put(0))
        except Exception as error:
            if not end_requests.empty():  # a library has replaced the KeyboardInterrupt of a signal
                return 0
            if not isinstance(error, USER_ERRORS):
                raise
            return _fail(name, str(error))
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, lambda received, _: end_requests.put(received))
        _spin(node, ended, end_requests)
        return 0
    finally:
        rclpy.try_shutdown()
        for number in (signal.SIGINT, signal.SIGTERM):
            # The interpreter restores the default of other handlers at its end: a late signal would then kill it.
            signal.signal(number, signal.SIG_IGN)


def _fail(name: str, problem: str) -> int:
    print(f"{name} cannot start:\n{problem}", file=sys.stderr)
    return 1


def _spin(node: ProgramNode, ended: threading.Event, end_requests: queue.SimpleQueue[int]) -> None:
    """Start the node, run its callbacks in a thread until `ended` or a request to end, and stop it."""
    assert isinstance(node, Node)
    nodes: list[Node] = [node, *getattr(node, "companions", ())]
    watches = [CallbackWatch(each) for each in nodes]
    executor = EventsExecutor()
    for each, watch in zip(nodes, watches, strict=True):
        watch.watch()
        executor.add_node(each)

    def spin() -> None:
        # EventsExecutor.spin() delivers nothing in rclpy 7.1.6 as built for PyPI; spin_once() does, and as fast.
        while not ended.is_set() and rclpy.ok():
            try:
                executor.spin_once(timeout_sec=0.1)
            except ExternalShutdownException:
                break
            except Exception as error:  # of a message that rclpy cannot take, for example
                watches[0].report("message or request", error)
        ended.set()

    spinning = threading.Thread(target=spin, name="executor", daemon=True)
    spinning.start()
    node.start()
    for watch in watches:
        watch.watch()  # what its node has created at its start
    realtime.wait_for(ended, end_requests)
    node.stop()
    executor.shutdown()
    spinning.join(timeout=JOIN_TIMEOUT)
    for each in nodes:
        each.destroy_node()
