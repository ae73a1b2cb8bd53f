"""Rerun: a motion shown live in a window or a browser, or written to an .rrd file.

Importing this package does not import Rerun; creating a `Viewer` does. Rerun runs in a process of its own.

| module | contents |
|---|---|
| `viewer` | `Viewer`: the simulation's side, with the queue before the viewer's process |
| `worker` | the viewer's process |
| `rows`, `scene` | the data sent: messages, rows of numbers; the mechanism with the paths of its entities |
| `stream`, `sinks` | the recording with its events; where it goes |
| `parts`, `joints`, `forces`, `constraints` | the mechanism, its forces, contacts and traces |
| `plots` | plots, and the layout of the window |
| `shapes` | solids for many samples at once |
"""

from __future__ import annotations

from mbd_sim.pictures.rerun.sinks import ViewerError
from mbd_sim.pictures.rerun.viewer import Viewer

__all__ = ["Viewer", "ViewerError"]
