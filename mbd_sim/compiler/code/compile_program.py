"""A program that compiles one long module: its standard input is the IR, its standard output the object code.

Its arguments are the processor, its features, and the level of LLVM's code generator.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time

from mbd_sim.compiler.code.object_code import object_code

PERIOD = 0.5  # s between two looks at whether the caller still runs


def _end_with(caller: int) -> None:
    while os.getppid() == caller:
        time.sleep(PERIOD)
    os._exit(1)


def main() -> None:
    """The program."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the caller, which then ends this program
    threading.Thread(target=_end_with, args=(os.getppid(),), daemon=True).start()
    _, cpu, features, level = sys.argv
    code = object_code(sys.stdin.buffer.read().decode(), cpu, features, int(level), is_long=True)
    sys.stdout.buffer.write(code)
    sys.stdout.buffer.flush()
    os._exit(0)  # without unloading LLVM


if __name__ == "__main__":
    main()
