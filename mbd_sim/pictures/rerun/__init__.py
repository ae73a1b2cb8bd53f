"""Rerun: a motion shown live in a window or a browser, or written to an .rrd file.

Importing this package does not import Rerun; creating a `Viewer` does. Rerun runs in a process of its own.

| module | contents |
|---|---|
| `viewer` | `Viewer`: the simulation's side, with the queue before the viewer's process |
| `worker` | the viewer's process, and the messages that it takes |
| `scene` | the data sent: the mechanism, and rows of numbers; what an entity is |
| `paths` | the paths of the entities |
| `stream`, `sinks` | the recording: parts, which move, and events; where it goes |
| `loads` | forces and couples as vectors, with their scale |
| `forces`, `constraints` | connectors and arrows; contacts, constrained points and traces |
| `plots` | plots, and the layout of the window |
"""

from __future__ import annotations

from mbd_sim.pictures.rerun.sinks import ViewerError
from mbd_sim.pictures.rerun.viewer import Viewer

__all__ = ["Viewer", "ViewerError"]
