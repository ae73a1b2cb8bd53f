"""What notebooks show: pictures with numbers, plots, animations and formulas."""

import base64
import io
import re
import subprocess
import sys
from html.parser import HTMLParser

import numpy as np
import pytest
from IPython.core.formatters import DisplayFormatter
from PIL import Image

from mbd_sim import InputError, Simulation, load_mechanism, symbolic_equations
from mbd_sim.notebook.formatters import FORMATTERS, register


class Table(HTMLParser):
    """The rows of a table, and the kind of each picture."""

    def __init__(self, text):
        super().__init__()
        self.rows, self.pictures, self._cells = {}, [], []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        if tag == "img":
            values = dict(attributes)
            kind, data = re.fullmatch(r"data:image/([\w+]+);base64,(.*)", values["src"]).groups()
            assert values["alt"]
            self.pictures.append((kind, base64.b64decode(data)))

    def handle_data(self, data):
        self._cells.append(data)

    def handle_endtag(self, tag):
        if tag == "tr":
            self.rows[self._cells[-2]] = self._cells[-1]


def shown_in_a_notebook(record):
    """What IPython displays, by MIME type."""
    display = DisplayFormatter()
    register(display.formatters)
    data, _ = display.format(record)
    return data


def test_importing_the_package_in_a_notebook_registers_its_formatters():
    program = """
from IPython.core.interactiveshell import InteractiveShell
formatters = InteractiveShell.instance().display_formatter.formatters
import mbd_sim
import sys
types = [f"{module}.{name}" for kind in formatters.values() for module, name in kind.deferred_printers]
print("numpy" in sys.modules, *(name for name in types if name.startswith("mbd_sim.")))
"""
    heavy, *names = subprocess.run(
        [sys.executable, "-c", program], check=True, capture_output=True, text=True
    ).stdout.split()
    assert heavy == "False"
    assert sorted(set(names)) == sorted({name for _, name, _ in FORMATTERS})


def test_a_mechanism_shows_its_degrees_of_freedom():
    data = shown_in_a_notebook(load_mechanism("four_bar"))
    assert data["image/png"].startswith(b"\x89PNG")
    table = Table(data["text/html"])
    assert (table.rows["degrees of freedom"], table.rows["parts"], table.rows["joints"]) == ("1", "3", "4")
    ((kind, picture),) = table.pictures
    assert kind == "svg+xml" and b"<svg" in picture


def test_a_simulation_shows_its_present_state():
    sim = Simulation.from_file("double_rod")
    first = sim._repr_png_()
    sim.run(until=0.5)
    table = Table(sim._repr_html_())
    assert table.rows["time"] == "0.5 s"
    assert table.rows["elbow"] == f"q = {sim.q[1]:.6g}, u = {sim.u[1]:.6g}"
    assert table.rows["kinetic"] == f"{sim.energies.kinetic:.6g} J"
    assert first != sim._repr_png_()
    with Image.open(io.BytesIO(first)) as picture:
        assert picture.format == "PNG"


def test_a_plot_runs_the_simulation_and_shows_it(tmp_path):
    sim, plain = Simulation.from_file("double_rod"), Simulation.from_file("double_rod")
    shown = sim.plot(until=0.2, show=["energies"])
    plain.run(until=0.2)
    assert np.array_equal(sim.state, plain.state)
    shown.save(tmp_path / "run.png")
    with Image.open(tmp_path / "run.png") as picture:
        assert picture.size[0] > 500
    assert len(repr(shown)) < 200
    with pytest.raises(ValueError, match=r"ends in \.png"):
        shown.save(tmp_path / "run.jpg")
    with pytest.raises(InputError, match=r"^show: there is no plot"):
        sim.plot(until=0.4, show=["energy"])
    with pytest.raises(InputError, match=r"show: there is no plot 'energy'. Did you mean 'energies'"):
        sim.plot(until=0.4, show="energy")
    assert sim.time == pytest.approx(0.2)  # a wrong name does not run the simulation


def test_an_animation_has_a_frame_every_forty_milliseconds():
    sim, plain = Simulation.from_file("double_rod"), Simulation.from_file("double_rod")
    shown = sim.animate(until=0.21, traces=["lower.tip"])
    plain.run(until=0.21)
    assert np.array_equal(sim.state, plain.state)
    ((kind, content),) = Table(shown._repr_html_()).pictures
    assert kind == "webp" and content == shown.content
    with Image.open(io.BytesIO(content)) as picture:
        assert (picture.n_frames, picture.size) == (6, (600, 400))
    with pytest.raises(InputError, match="Did you mean 'tip'"):
        sim.animate(until=1.0, traces=["lower.tipp"])
    with pytest.raises(InputError, match="Did you mean 'tip'"):
        sim.animate(until=1.0, traces="lower.tipp")
    for time in (np.nan, np.inf):
        with pytest.raises(ValueError, match="the time must be finite"):
            sim.animate(until=time)
    with pytest.raises(ValueError, match="later time"):
        sim.animate(until=0.1)


@pytest.mark.parametrize("name", ["double_rod", "four_bar", "upright_wheel"])
def test_equations_are_one_formula(name):
    text = shown_in_a_notebook(symbolic_equations(load_mechanism(name), ()))["text/latex"]
    assert text.startswith("$") and text.endswith("$") and text.count("$") == 2
    assert text.count(r"\begin") == text.count(r"\end") and "align*" not in text and r"\text{" not in text
    assert text.count("{") == text.count("}")
