"""The entry points of the installed programs: imports no library before Ctrl-C is handled.

A program imports its libraries for up to a second. Ctrl-C in that time would print a traceback, in the middle of an
import. A console script such as `sim_node = mbd_sim.programs:node.ros.sim_node.main` calls the function `main` of the
module `mbd_sim.ros.sim_node`.
"""

# PYTHON_ARGCOMPLETE_OK: activate-global-python-argcomplete looks for this in the module of a console script

from __future__ import annotations

import importlib
import os
import signal
import sys
from collections.abc import Callable, Sequence
from types import FrameType
from typing import cast

from mbd_sim.interrupts import raise_interrupt
from mbd_sim.plain_output import use_plain_characters

INTERRUPTED = 130  # exit code of a command after Ctrl-C, as in a shell


class EntryPoint:
    """A function by its dotted path in the package, to be imported when it is called."""

    def __init__(self, path: Sequence[str], exit_code: int) -> None:
        """`exit_code` is that of the program when a signal ends it while it imports."""
        self._path, self._exit_code = tuple(path), exit_code

    def __getattr__(self, name: str) -> EntryPoint:
        if name.startswith("__"):
            raise AttributeError(name)
        return EntryPoint((*self._path, name), self._exit_code)

    def __call__(self) -> int:
        """Import the module and call the function; its return value is the exit code."""
        signal.signal(signal.SIGINT, lambda *_: os._exit(self._exit_code))
        use_plain_characters()
        main = self._imported()
        interrupts: list[int] = []

        def interrupt(number: int, frame: FrameType | None) -> None:
            interrupts.append(number)
            raise_interrupt(frame)

        signal.signal(signal.SIGINT, interrupt)
        try:
            try:
                return int(main())
            finally:
                if sys.stdout is not None:
                    sys.stdout.flush()  # here, and not when the interpreter ends, which would print the error
        except KeyboardInterrupt:
            return self._exit_code
        except ImportError:
            if interrupts:  # within a library's import of a C extension, which replaces the exception
                return self._exit_code
            raise
        except BrokenPipeError:  # what reads the output, such as `head`, has ended
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return 1

    def _imported(self) -> Callable[[], int]:
        """The function; the program ends with a message where a package is missing, such as ROS."""
        *module, function = self._path
        try:
            return cast("Callable[[], int]", getattr(importlib.import_module(".".join(("mbd_sim", *module))), function))
        except ModuleNotFoundError as error:
            from mbd_sim.packages import missing_package

            if (explained := missing_package(error)) is None:
                raise
            sys.exit(str(explained))


node = EntryPoint((), 0)  # a node ends by SIGINT without an error
command = EntryPoint((), INTERRUPTED)
