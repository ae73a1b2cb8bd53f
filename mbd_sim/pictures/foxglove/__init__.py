"""Foxglove: a motion shown live by a server to which Foxglove's program or page connects.

Importing this package does not import Foxglove's SDK. The server runs in a process of its own, like Rerun's.

| module | contents |
|---|---|
| `viewer` | `FoxgloveViewer`: the simulation's side |
| `worker` | the server's process |
| `stream` | the server, its topics and their messages |
| `entities` | the scene: what is fixed in parts, and what is computed for each sample |
| `playback` | a recorded run, played and searched from Foxglove's time bar |
"""

from __future__ import annotations

from mbd_sim.pictures.foxglove.viewer import FoxgloveViewer

__all__ = ["FoxgloveViewer"]
