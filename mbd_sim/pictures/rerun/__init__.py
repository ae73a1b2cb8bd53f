"""Rerun: a motion shown live in a window or a browser, or written to an .rrd file.

Importing this package does not import Rerun; creating a `Viewer` does. Rerun runs in a process of its own.

| module | contents |
|---|---|
| `viewer` | `Viewer`: the simulation's side |
| `worker`, `protocol`, `mailbox` | the viewer's process, the messages to it, and the queue before it |
| `sample_rows`, `scene_description` | the data sent: samples as rows of numbers, the mechanism once |
| `rerun_stream`, `sinks`, `rerun_process` | the recording, where it goes, and Rerun's own program |
| `blueprint`, `entity_paths` | the layout of the window, the paths of entities |
| `entity` | the interface of everything that is drawn |
| `part_entities`, `joint_entities`, `spring_entities`, `drive_entities`, `constraint_entities` | the mechanism |
| `arrow_entities`, `trace_entities`, `plot_entities` | forces, traces and plots |
| `rerun_shapes`, `part_poses`, `joint_coordinates` | solids, poses and coordinates for many samples at once |
| `event_filter`, `event_log` | which events are shown, and how |
"""

from __future__ import annotations

from mbd_sim.pictures.rerun.sinks import ViewerError
from mbd_sim.pictures.rerun.viewer import Viewer

__all__ = ["Viewer", "ViewerError"]
