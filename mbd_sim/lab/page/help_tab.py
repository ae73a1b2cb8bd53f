"""How to use the page, and what `mbd_sim check` says about the mechanism."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

from mbd_sim.base.errors import MbdSimError
from mbd_sim.lab.session.frames import Frame

HELP = """
**Look:** drag the background to turn, the wheel or two fingers to come closer, the right button to move.

**Take hold:** drag a part with the mouse or a finger. While it runs, a spring and a damper pull it (the red arrow is
their force, counted as applied work). While it is paused, the mechanism follows the pointer with its loops closed.

**Keys:** space plays and pauses · right arrow takes a step · left arrow goes back · Home returns to the start.

**Change:** move a slider or type a number. *Copy as YAML* shows what to write into the file. Save the file in any
editor: the page follows, and parts of the same names stay where they are.

**Keep:** a recording contains every change, and `mbd_sim verify` recomputes it bit for bit. The page *with motion* is
one file that opens anywhere, without a network.
"""


class HelpTab:
    """The help, and the report of `check`, which is found in a thread of its own."""

    def __init__(self, gui: Any, check: Callable[[], str] | None) -> None:
        gui.add_markdown(HELP)
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
