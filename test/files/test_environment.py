"""Reading a mechanism file changes nothing that other threads and child processes of a program see."""

import os
import subprocess
import sys

PROGRAM = """
import sys
import numpy  # whose own import sets a variable
changes = []
sys.addaudithook(lambda event, arguments: event in ("os.putenv", "os.unsetenv") and changes.append(arguments))
from mbd_sim import load_mechanism
load_mechanism("double_rod")
print(changes)
"""


def test_the_environment_of_the_process_stays_as_it_is():
    environment = os.environ | {"MBD_SIM_CACHE": "off"}
    command = [sys.executable, "-c", PROGRAM]
    assert subprocess.run(command, check=True, capture_output=True, text=True, env=environment).stdout == "[]\n"
