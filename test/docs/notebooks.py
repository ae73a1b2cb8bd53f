"""Runs notebooks and snippets of the pages in this process."""

import contextlib
import itertools
import re
import shlex
import shutil
import subprocess
from importlib.util import find_spec
from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from mbd_sim.cli.main import main
from mbd_sim.dynamics.equations import derive
from mbd_sim.files.load import load_mechanism
from mbd_sim.pictures.drawing import animation

CELL = re.compile(r"^```\{code-cell\}[^\n]*\n(.*?)^```$", re.MULTILINE | re.DOTALL)
QUIET = ("run", "verify", "rerun-with", "plot", "export")
OPTIONS = re.compile(r"\A(?::[\w-]+:[^\n]*\n)+")


def cells(text):
    """The code cells of a notebook in MyST's form."""
    return [OPTIONS.sub("", cell) for cell in CELL.findall(text)]


def execute(code, names):
    """Run a cell: Python, `%%writefile NAME` and its text, and lines `!mbd_sim …`."""
    first, _, rest = code.partition("\n")
    if first.startswith("%%writefile "):
        Path(first.split()[1]).write_text(rest, encoding="utf-8")
        return
    names["_command"] = _command
    exec(
        re.sub(r"^(\s*)!(mbd_sim .*)$", r"\1_command(\2)".replace(r"\2", r"'''\2'''"), code, flags=re.MULTILINE), names
    )


def _command(line):
    assert main(shlex.split(line)[1:]) == 0, line


SNIPPET = re.compile(r"^```(\w+)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
WINDOWS = (
    "view",
    "sweep",
    "--foxglove",
    "--rerun",
    "robot.urdf",
    "mbd_sim import ",
    "engine.yaml",
)  # what opens a window, takes long, or has no file; test_docs parses it


FEW = re.compile(r"(?<=positions=)\d+|(?<=samples[= ])\d+")  # of motions, and of tolerances
RANGE = re.compile(r"(.+=.+?:[^:]+)(?::\d+)?\Z")  # NAME=FROM:TO:POSITIONS
POSITIONS = {"kinematics": 5, "centers": 5, "size": 5, "modes": 3, "optimize": 9}
ROWS = re.compile(r"(?<=\\n\" \* )\d+")  # of a table that a page writes; `optimize` takes as many positions


def _coarser(words):
    """The words of a command, of a motion or a locus with few positions."""
    most, options = POSITIONS.get(words[1]), ("--drive", "--vary") if words[1] == "modes" else ("--drive",)
    before = ["", *words]
    return [RANGE.sub(rf"\1:{most}", word) if most and before[at] in options else word for at, word in enumerate(words)]


@contextlib.contextmanager
def undrawn():
    """Compose pictures, but do not draw them, which takes most of the time of a page: they are empty, or white.

    Animations have their first two frames.
    """

    def touch(figure, path, **_):
        path.write(b"") if hasattr(path, "write") else Path(path).write_bytes(b"")

    kept = Figure.savefig, Figure.draw_without_rendering, FigureCanvasAgg.draw, ConstrainedLayoutEngine.execute
    Figure.savefig, Figure.draw_without_rendering = touch, lambda figure: None
    images, animation._images = animation._images, lambda frames: images(itertools.islice(frames, 2))
    FigureCanvasAgg.draw = lambda canvas: canvas.get_renderer()
    ConstrainedLayoutEngine.execute = lambda engine, figure: None
    try:
        yield
    finally:
        Figure.savefig, Figure.draw_without_rendering, FigureCanvasAgg.draw, ConstrainedLayoutEngine.execute = kept
        animation._images = images


def snippets(text):
    """The language and the code of each block of a page, in order."""
    return SNIPPET.findall(text)


def execute_snippet(language, code):
    """Run a snippet: a mechanism and a C program are written to files; commands `mbd_sim` and `gcc` are executed."""
    if language == "yaml" and (name := re.match(r"mechanism: (\w+)\n", code)):
        Path(f"{name[1]}.yaml").write_text(code, encoding="utf-8")
        derive(load_mechanism(f"{name[1]}.yaml"))
    elif language == "python" and "fmpy" in code and not find_spec("fmpy"):
        return  # an extra of the tests
    elif language == "python" and "rclpy" not in code and "Lockstep" not in code:
        exec(FEW.sub("5", ROWS.sub(str(POSITIONS["optimize"]), code)), {"__name__": "__main__"})
    elif language == "c":
        Path("main.c").write_text(code, encoding="utf-8")
    elif language == "sh":
        for line in FEW.sub("5", code).replace("\\\n", " ").splitlines():
            words = shlex.split(line, comments=True)
            words = _coarser(words) if words[:1] == ["mbd_sim"] else words
            if "--animate" in words and words[1] == "run":
                words += ["--time", "0.04"]  # two pictures: they take long
            serves = words[1:2] == ["lab"] and "--html" not in words  # until Ctrl-C
            if words[:1] == ["mbd_sim"] and not serves and not any(word in line for word in WINDOWS):
                assert main([*words[1:], "--quiet"] if words[1] in QUIET else words[1:]) == 0, line
            elif words[:1] in (["gcc"], ["./swing"]) and shutil.which("gcc"):
                subprocess.run([word.replace("-O3", "-O0") for word in words], check=True)
