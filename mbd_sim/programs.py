"""The entry points of the installed programs: import no library before signals are handled.

A program imports its libraries for up to a second. Ctrl-C in that time would print a traceback, in the middle of an
import, and SIGTERM would end a node with an error. A console script such as
`sim_node = mbd_sim.programs:node.ros.node.sim_node.main` calls the function `main` of the module
`mbd_sim.ros.node.sim_node`.

Only the start of the interpreter itself, of about 0.1 s, comes before: SIGTERM then has its default effect, and Python
reports Ctrl-C in its own way.
"""

# PYTHON_ARGCOMPLETE_OK: activate-global-python-argcomplete looks for this in the module of a console script

from __future__ import annotations

import atexit
import importlib
import os
import signal
import sys
from typing import TYPE_CHECKING, cast

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from types import FrameType

    Handler = Callable[[int, FrameType | None], object]

SIGNALS = (signal.SIGINT, signal.SIGTERM)


class EntryPoint:
    """A function by its dotted path in the package, to be imported when it is called."""

    def __init__(self, path: Sequence[str], *, is_node: bool) -> None:
        """A node that a signal ends has the exit code 0, a command 128 more than the number, as in a shell."""
        self._path, self._is_node = tuple(path), is_node

    def __getattr__(self, name: str) -> EntryPoint:
        if name.startswith("__"):
            raise AttributeError(name)
        return EntryPoint((*self._path, name), is_node=self._is_node)

    def __call__(self) -> int:
        """Import the module and call the function; its return value is the exit code."""
        _handle(lambda number, _: os._exit(self._exit_code(number)))
        atexit.register(_handle, signal.SIG_IGN)  # when the interpreter ends, it restores the default of other handlers
        from mbd_sim.base.plain_output import use_plain_characters, use_plain_warnings

        use_plain_characters()
        use_plain_warnings()
        main = self._imported()
        from mbd_sim.base.interrupts import raise_interrupt, repeat_interrupt

        sys.unraisablehook = repeat_interrupt
        received: list[int] = []

        def interrupt(number: int, frame: FrameType | None) -> None:
            received.append(number)
            raise_interrupt(frame)

        try:
            code = self._result(main, interrupt, received)
        except KeyboardInterrupt:  # another signal, while the first one ended the program
            os._exit(self._exit_code(received[-1]))
        return self._exit_code(received[-1]) if code and received else code

    def _result(self, main: Callable[[], int], interrupt: Handler, received: Sequence[int]) -> int:
        """What the function returns; 1 if one of the signals `received`, or the end of a reader, has interrupted it."""
        try:
            try:
                _handle(interrupt)
                return int(main())
            finally:
                if sys.stdout is not None:
                    sys.stdout.flush()  # here, and not when the interpreter ends, which would print the error
        except BrokenPipeError:  # what reads the output, such as `head`, has ended
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return 1
        except (KeyboardInterrupt, Exception):  # libraries may replace KeyboardInterrupt, as NumPy does in its import
            if not received:
                raise
            return 1
        finally:
            _handle(lambda number, _: os._exit(self._exit_code(number)))

    def _exit_code(self, number: int) -> int:
        """The exit code of the program when a signal ends it."""
        return 0 if self._is_node else 128 + number

    def _imported(self) -> Callable[[], int]:
        """The function; the program ends with a message where a package is missing, such as ROS."""
        *module, function = self._path
        try:
            return cast("Callable[[], int]", getattr(importlib.import_module(".".join(("mbd_sim", *module))), function))
        except ModuleNotFoundError as error:
            from mbd_sim.base.packages import missing_package

            if (explained := missing_package(error)) is None:
                raise
            sys.exit(str(explained))


def _handle(handler: Handler | signal.Handlers) -> None:
    """Let a function handle the signals that end a program."""
    for number in SIGNALS:
        signal.signal(number, handler)


node = EntryPoint((), is_node=True)
command = EntryPoint((), is_node=False)
