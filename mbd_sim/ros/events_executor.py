"""The executor of events, wherever the installed `rclpy` has it: in Jazzy and Kilted it is experimental."""

from __future__ import annotations

try:
    from rclpy.executors import EventsExecutor
except ImportError:
    from rclpy.experimental import EventsExecutor

__all__ = ["EventsExecutor"]
