"""The motion shown in Rerun: live in a window or a browser, or written to an .rrd file.

Importing this package does not import Rerun; making a `Viewer` does.
"""

from __future__ import annotations

from mbd_sim.viewer.sinks import ViewerError
from mbd_sim.viewer.viewer import Viewer

__all__ = ["Viewer", "ViewerError"]
