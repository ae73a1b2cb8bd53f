"""The process that compiles long modules: it ends without a word if its caller is gone."""

import os
import subprocess
import sys

PROGRAM = "from mbd_sim.compiler import compile_process; compile_process.object_code = lambda *_: bytes(200_000)\n"


def test_it_says_nothing_where_nobody_waits_for_the_code():
    reader, writer = os.pipe()
    command = [sys.executable, "-c", f"{PROGRAM}compile_process.main()", "cpu", "features", "1"]
    with subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=writer, stderr=subprocess.PIPE) as child:
        os.close(reader)
        os.close(writer)
        assert (child.communicate()[1], child.returncode) == (b"", 1)
