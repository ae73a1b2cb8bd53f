"""The executor of events, wherever the installed `rclpy` has it: in Jazzy and Kilted it is experimental."""

from __future__ import annotations

import rclpy.executors

if hasattr(rclpy.executors, "EventsExecutor"):
    EventsExecutor = rclpy.executors.EventsExecutor
else:
    from rclpy.experimental import EventsExecutor

__all__ = ["EventsExecutor"]
