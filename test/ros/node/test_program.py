"""A node as a program: Ctrl-C ends it at whatever moment it arrives."""

import signal
import subprocess
import sys

import pytest

from test.system.nodes import new_domain
from test.waiting import PATIENCE

# Sends SIGINT before one line after another of those that Python executes while the main thread waits.
PROGRAM = '''
import itertools, signal, sys
from rclpy.node import Node
from mbd_sim.ros.node.program import run_node

class Interrupted(Node):
    def __init__(self, number):
        super().__init__("interrupted")
        self.number, self.lines = number, itertools.count(1)

    def start(self):
        sys.settrace(self.trace)

    def trace(self, frame, event, _):
        waits = frame.f_code.co_filename.endswith(("threading.py", "realtime.py"))
        if waits and event == "line" and next(self.lines) == self.number:
            signal.raise_signal(signal.SIGINT)
        return self.trace if waits else None

    def stop(self):
        sys.settrace(None)

for number in range(1, 8):
    print("interrupted before line", number, flush=True)
    assert run_node("interrupted", lambda end: Interrupted(number), [], example="x", help_text=str) == 0

def deaf(number):
    """A node; the exception of a signal that arrives while it is built is dropped, as in CasADi."""
    try:
        signal.raise_signal(number)
    except KeyboardInterrupt:
        print("dropped", flush=True)
    return Interrupted(0)

for number in (signal.SIGINT, signal.SIGTERM):
    assert run_node("interrupted", lambda end: deaf(number), [], example="x", help_text=str) == 0
'''


def test_a_signal_ends_the_program_whenever_it_arrives(monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", str(new_domain()))
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    subprocess.run([sys.executable, "-c", PROGRAM], check=True, timeout=PATIENCE)


# glibc calls `raise(exit code)` when the interpreter has ended.
LATE = """
import ctypes, sys
from rclpy.node import Node
from mbd_sim.ros.node.program import run_node

class Ending(Node):
    def __init__(self, end):
        super().__init__("ending")
        self.start = end

    def stop(self):
        pass

assert run_node("ending", Ending, [], example="x", help_text=str) == 0
libc = ctypes.CDLL(None)
libc.on_exit(getattr(libc, "raise"), None)
sys.exit({number})
"""


@pytest.mark.parametrize("number", [signal.SIGINT])
def test_a_signal_while_the_interpreter_ends_changes_nothing(number, monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", str(new_domain()))
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    ended = subprocess.run([sys.executable, "-c", LATE.format(number=int(number))], timeout=PATIENCE)
    assert ended.returncode == number
