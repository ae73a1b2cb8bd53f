"""Callbacks that nothing that arrives over DDS can make fail: errors are answered and reported, and the node continues.

rclpy ends the executor with the exception of a callback, also with those of its own parameter services, such as
that of a parameter whose type does not exist.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import wraps
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.node import Node

from mbd_sim.errors import quoted
from mbd_sim.ros.parameter_requests import Service, set_one_at_a_time

REPORT_PERIOD = 1.0  # s between reports


class CallbackGuard:
    """Guards the callbacks of a node. `failures` counts the messages and requests that a callback could not process."""

    def __init__(self, node: Node) -> None:
        self.failures = 0
        self._node, self._log = node, node.get_logger()
        self._guarded: set[int] = set()
        self._last_report = -REPORT_PERIOD

    def guard(self) -> None:
        """Guard all subscriptions, services and timers that the node has now."""
        for subscription in self._new(self._node.subscriptions):
            subscription.callback = self._guarded_message(
                subscription.callback, f"message on {subscription.topic_name}"
            )
        for timer in self._new(self._node.timers):
            timer.callback = self._guarded_message(timer.callback, "timer")
        for service in self._new(self._node.services):
            callback = service.callback
            if service.srv_type is SetParameters:
                callback = set_one_at_a_time(self._node, callback, _reason)
            service.callback = self._guarded_service(callback, service)

    def report(self, what: str, error: Exception) -> None:
        """Count a failure, and log it if none was logged in the last second."""
        self.failures += 1
        now = time.monotonic()
        if now - self._last_report >= REPORT_PERIOD:
            self._last_report = now
            self._log.error(f"{what} not processed ({self.failures} failures so far): {_reason(error)}")

    def _new(self, entities: Any) -> list[Any]:
        found = [entity for entity in entities if id(entity) not in self._guarded]
        self._guarded.update(map(id, found))
        return found

    def _guarded_message(self, callback: Callable[..., None], what: str) -> Callable[..., None]:
        @wraps(callback)
        def guarded(*arguments: Any) -> None:
            try:
                callback(*arguments)
            except Exception as error:
                self.report(what, error)

        return guarded

    def _guarded_service(self, callback: Service, service: Any) -> Service:
        @wraps(callback)
        def guarded(request: Any, response: Any) -> Any:
            try:
                return callback(request, response)
            except Exception as error:
                self.report(f"request of {service.service_name}", error)
                return _refusal(service.srv_type, _reason(error))

        return guarded


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
