"""Arbitrary bytes as requests of a service: rclpy can send them on topics, but not to services.

The request of a service is a DDS topic. `rmw` creates a publisher for it when it is asked to leave the name as it is.
"""

from __future__ import annotations

import contextlib
import ctypes
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from rclpy.node import Node

from test.waiting import wait_until

_ADDRESS, _SIZE, _INT = ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int


class _Duration(ctypes.Structure):
    _fields_ = [("sec", ctypes.c_uint64), ("nsec", ctypes.c_uint64)]


class _Profile(ctypes.Structure):  # rmw_qos_profile_t
    _fields_ = [
        ("history", _INT),
        ("depth", _SIZE),
        ("reliability", _INT),
        ("durability", _INT),
        ("deadline", _Duration),
        ("lifespan", _Duration),
        ("liveliness", _INT),
        ("liveliness_lease_duration", _Duration),
        ("avoid_ros_namespace_conventions", ctypes.c_bool),
    ]


class _Options(ctypes.Structure):  # rmw_publisher_options_t
    _fields_ = [("payload", _ADDRESS), ("unique_flow", _INT)]


class _Bytes(ctypes.Structure):  # rmw_serialized_message_t
    _fields_ = [("buffer", _ADDRESS), ("length", _SIZE), ("capacity", _SIZE), ("allocator", _ADDRESS * 5)]


def _library(*names: str) -> ctypes.CDLL:
    """The first of these libraries that rclpy has loaded, by the path from which it was loaded."""
    lines = Path("/proc/self/maps").read_text(encoding="utf-8").splitlines()
    paths = [line.split()[-1] for name in names for line in lines if f"/{name}.so" in line]
    return ctypes.CDLL(paths[0])


@contextlib.contextmanager
def raw_requests(node: Node, service_type: Any, service: str) -> Iterator[Callable[[bytes], bool]]:
    """A function that sends bytes as a request to a service, given by its full name without the leading slash.

    It returns whether they were sent: a request of fixed size cannot be longer than that.
    """
    package, name = service_type.__module__.split(".")[0], service_type.__name__
    rcl, rmw = _library("librcl"), _library("librmw_implementation", "librmw_fastrtps_cpp")
    support = ctypes.CDLL(f"lib{package}__rosidl_typesupport_c.so")
    handle = getattr(support, f"rosidl_typesupport_c__get_message_type_support_handle__{package}__srv__{name}_Request")
    handle.restype, handle.argtypes = _ADDRESS, []
    rcl.rcl_node_get_rmw_handle.restype, rcl.rcl_node_get_rmw_handle.argtypes = _ADDRESS, [_ADDRESS]
    rmw.rmw_create_publisher.restype = _ADDRESS
    rmw.rmw_create_publisher.argtypes = [
        _ADDRESS, _ADDRESS, ctypes.c_char_p, ctypes.POINTER(_Profile), ctypes.POINTER(_Options),
    ]  # fmt: skip
    rmw.rmw_publish_serialized_message.argtypes = [_ADDRESS, ctypes.POINTER(_Bytes), _ADDRESS]
    rmw.rmw_publisher_count_matched_subscriptions.argtypes = [_ADDRESS, ctypes.POINTER(_SIZE)]
    rmw.rmw_destroy_publisher.argtypes = [_ADDRESS, _ADDRESS]
    owner = rcl.rcl_node_get_rmw_handle(node.handle.pointer)
    profile = _Profile(history=1, depth=10, reliability=1, durability=2, avoid_ros_namespace_conventions=True)
    topic = f"rq/{service}Request".encode()
    publisher = rmw.rmw_create_publisher(owner, handle(), topic, profile, _Options())
    assert publisher, f"no publisher for {service}"

    def send(data: bytes) -> bool:
        buffer = ctypes.create_string_buffer(data, max(len(data), 1))
        message = _Bytes(ctypes.addressof(buffer), len(data), len(buffer))
        return bool(rmw.rmw_publish_serialized_message(publisher, message, None) == 0)

    def matched() -> bool:
        count = _SIZE()
        rmw.rmw_publisher_count_matched_subscriptions(publisher, count)
        return count.value > 0

    try:
        wait_until(matched, f"the service {service}")
        yield send
    finally:
        rmw.rmw_destroy_publisher(owner, publisher)
