"""Services whose answers come later, without anything that waits for them.

The executor of events continues a coroutine of a service over and over while this waits, which takes all of a processor
and of the interpreter's time that the stepping thread needs.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.node import Node


class LateService:
    """A service of a node; all of it happens in the executor's thread."""

    def __init__(self, node: Node, kind: Any, name: str, callback: Callable[[Any, Any], Any]) -> None:
        """:param callback: takes request and response, and returns the response, or None if `send` gets it later."""
        self._callback, self._asked = callback, None
        self._waiting: dict[int, tuple[Any, Any]] = {}  # responses and headers of their requests
        service = node.create_service(kind, name, self._on_request)
        self._send, service.send_response = service.send_response, self._on_response

    def send(self, response: Any) -> None:
        """Answer the request that came with this response."""
        _, header = self._waiting.pop(id(response))
        self._send(response, header)

    def _on_request(self, request: Any, response: Any) -> Any:
        self._asked = response
        return self._callback(request, response)

    def _on_response(self, response: Any, header: Any) -> None:
        """Take what the callback has returned, with the header of its request: rclpy would send it."""
        if response is None:
            self._waiting[id(self._asked)] = self._asked, header
        else:
            self._send(response, header)
