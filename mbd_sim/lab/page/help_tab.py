"""How to use the page, and what `mbd_sim check` says about the mechanism."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

from mbd_sim.base.errors import MbdSimError
from mbd_sim.lab.session.frames import Frame

HELP = """
**Look:** drag the background to turn, the wheel or two fingers to come closer, the right button to move.

**Take hold:** drag a part with the mouse or a finger. While it runs, a spring and a damper pull it, with at most ten
times the weight of the whole mechanism on Earth. The red arrow is their force; its work is counted as applied. While it
is paused, the mechanism follows the pointer with its loops closed.

**Keys:** space plays and pauses · right arrow takes a step · left arrow goes back · Home returns to the start.

**Change:** move a slider or type a number. Lengths and gains have sliders if they are `parameters` of the file; its
`ranges` are their ends. *Copy as YAML* has what to write into the file. Save the file in any editor: the page follows,
and what has the same names goes on.

**Control:** a mechanism has a controller if its file gives it `actuators` with a `servo`. Its commands and gains are in
*Change*. The shipped `cart_servo` has one for exercises: `mbd_sim lab cart_servo`.

**Curves of points:** *Show* has the trace of any point. *Kinematics* draws the whole path of a point while a joint
turns, which follows changed lengths. *Keep this curve* leaves it in gray, to compare it with that of other lengths.
There are dead points, limit positions and the transmission angle too.

**Inverse kinematics:** choose a point in *Kinematics*, *Bring a point to a target*, and drag the arrows in the scene or
type where it shall be. The joints are listed, and what is left if it is out of reach.

**Points of your own:** `mbd_sim convert four_bar > my.yaml` writes a file of your own. Add a point under `points:` of a
part, such as `P: [0.7, 0, 0.5]` in its frame, and open it: `mbd_sim lab my.yaml`.

**Keep:** a recording contains every change, and `mbd_sim verify` recomputes it bit for bit. The page *with motion* is
one file that opens anywhere, without a network.
"""

HELP_OF_NODE = """
**This is the run of a node.** What the page does goes the way of messages and services: buttons are `~/pause`,
`~/step` and `~/reset`, the speed is `real_time_factor`, sliders are parameters and commands. Sliders follow what others
command. Efforts and pulls last as long as a page is open, or until others command the same; then `command_timeout` ends
them. Time is not wound back, as other nodes follow it, and the page does not follow the file.

**Keep:** *Record* is `~/record`: the node names the file, and it contains all that the page does.
"""


class HelpTab:
    """The help, and the report of `check`, which is found in a thread of its own."""

    def __init__(self, gui: Any, check: Callable[[], str] | None, *, of_node: bool) -> None:
        gui.add_markdown(
            HELP_OF_NODE + HELP.partition("**Change:**")[0].replace(" · left arrow goes back", "") if of_node else HELP
        )
        self._report = ""
        if check is not None:
            with gui.add_folder("What `mbd_sim check` says", expand_by_default=False):
                self._shown = gui.add_markdown("…")
            threading.Thread(target=self._find, args=(check,), daemon=True).start()

    def show(self, _: Frame) -> None:
        """Show the report once it is found."""
        if self._report:
            self._shown.content, self._report = self._report, ""

    def _find(self, check: Callable[[], str]) -> None:
        try:
            self._report = f"```text\n{check()}\n```"
        except MbdSimError as error:
            self._report = f"```text\n{error}\n```"
