"""Plots of recorded runs as pictures and HTML pages."""

import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.image import imread

from mbd_sim import Simulation
from mbd_sim.base.errors import InputError
from mbd_sim.cli.main import main
from mbd_sim.cli.shared.common import RUN_PLOTS
from mbd_sim.cli.shared.common import STYLES as STYLE_OPTIONS
from mbd_sim.cli.shared.common import THEMES as THEME_OPTIONS
from mbd_sim.recordings.run.reader import open_recording
from mbd_sim.recordings.views.panels import STYLES, THEMES, panels, plot_style, require_names
from mbd_sim.recordings.views.plots import _align_labels, draw
from mbd_sim.recordings.views.table import read_table
from test.docs.notebooks import undrawn
from test.recordings.runs import record_run
from test.recordings.views.test_table import foreign_bag


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    return record_run(tmp_path_factory.mktemp("pictures"), "double_rod", seconds=1.0, seed=3, commands=6)


def test_panels_contain_the_table(recording):
    table = read_table(open_recording(recording))
    found = {(panel.title, panel.y_label): panel for panel in panels(table)}
    assert {title for title, _ in found} == {
        "Energies", "Position", "Velocity", "Effort", "Energy residual", "Phase portrait",
    }  # fmt: skip
    (residual,) = found["Energy residual", "|residual| (J)"].lines
    assert np.all(residual.y[~np.isnan(residual.y)] > 0.0)
    for row, line in enumerate(found["Phase portrait", "velocity (rad/s)"].lines):
        kept = ~np.isnan(line.x)
        assert np.count_nonzero(~kept) == len(table.resets)
        np.testing.assert_array_equal(line.x[kept], table.position[:, row])
        np.testing.assert_array_equal(line.y[kept], table.velocity[:, row])


def test_panels_of_rotations_and_displacements_have_different_titles(tmp_path):
    recorded = record_run(tmp_path, "cart_pendulum_spring", seconds=0.1, seed=3, commands=2)
    titles = [panel.title for panel in panels(read_table(open_recording(recorded)))]
    assert len(titles) == len(set(titles))
    assert {"Displacement", "Angle", "Velocity", "Angular velocity", "Phase portrait of rotations"} <= set(titles)


def test_a_run_is_plotted_as_chosen(tmp_path, capsys):
    path = tmp_path / "run.svg"
    run = ["run", "double_rod", "--time", "0.1", "--quiet", "--plot", str(path)]
    assert main([*run, "--show", "residual,reactions"]) == 0
    assert ElementTree.parse(path).getroot().tag.endswith("svg")
    text = path.read_text(encoding="utf-8")
    assert "Energy residual" in text
    assert "Position" not in text
    assert f"{path}: energy residual, reaction force, reaction moment" in capsys.readouterr().out
    assert main([*run, "--show", "reaction"]) == 1
    assert "show: there is no plot 'reaction'. Did you mean 'reactions'" in capsys.readouterr().err
    assert main([*run[:-2], "--show", "residual"]) == 1
    assert "--show: nothing is plotted. Give --plot too." in capsys.readouterr().err


def test_forces_of_contacts_and_of_joints_have_panels_of_their_own(tmp_path, capsys):
    """Columns of contacts were taken for those of joints, which ended a run with `--contact-forces` and `--plot` in a traceback."""
    run = ["run", "rocking", "--time", "0.1", "--quiet"]
    file = str(tmp_path / "run.mcap")
    with undrawn():
        assert main([*run, "--out", file, "--plot", str(tmp_path / "run.png"), "--show", "contacts,reactions"]) == 0
    table = read_table(open_recording(file))
    (forces,) = panels(table, ["contacts"])
    assert len(forces.lines) == 1
    assert np.nanmax(forces.lines[0].y) > 0.0
    assert {panel.title for panel in panels(table, ["reactions"])} == {"Reaction force", "Reaction moment"}


def test_a_picture_is_not_empty(recording, tmp_path):
    path = tmp_path / "run.png"
    assert main(["plot", str(recording), "--out", str(path), "--show", "energies,phase", "--quiet"]) == 0
    pixels = imread(path)
    assert min(pixels.shape[:2]) > 500
    assert np.mean(np.any(pixels[..., :3] < 0.9, axis=-1)) > 0.01


def test_labels_of_axes_are_in_one_line_beside_the_widest_number():
    figure = Figure(layout="constrained")
    all_axes = figure.subplots(3, 1)
    for axes, scale in zip(all_axes, (1.0, -1e4, 3e-15), strict=True):
        axes.plot([1.0, 2.0], [scale, 2.2 * scale])
        axes.set_ylabel("energy (J)")
    all_axes[2].set_yscale("log")  # with labels of minor ticks, which are the widest
    _align_labels(figure, all_axes)
    renderer = FigureCanvasAgg(figure).get_renderer()
    figure.draw(renderer)
    ends = [axes.yaxis.label.get_window_extent(renderer).x1 for axes in all_axes]
    assert np.ptp(ends) < 0.01
    numbers = [label for axes in all_axes for label in axes.get_yticklabels(which="both") if label.get_text()]
    assert 0.0 < min(label.get_window_extent(renderer).x0 for label in numbers) - ends[0] < 10.0


def test_a_style_has_one_width(recording, tmp_path):
    path = tmp_path / "run.png"
    widths = {"screen": 990, "slide": 1920, "paper": 1050}
    styles = {name: plot_style(path, name) for name in widths}
    assert {name: round(style.width * style.resolution) for name, style in styles.items()} == widths
    arguments = ["plot", str(recording), "--out", str(path), "--show", "residual", "--style", "paper", "--quiet"]
    assert main([*arguments, "--theme", "dark"]) == 0
    pixels = imread(path)
    assert pixels.shape[1] == widths["paper"]
    assert pixels[0, 0, :3].max() < 0.1 and pixels[..., :3].max() > 0.8  # light on dark


def test_a_paper_has_dashes_and_names_in_place_of_titles(recording):
    table = read_table(open_recording(recording))
    (panel,) = panels(table, ["energies"])
    style = plot_style(Path("run.pdf"), "paper")
    dashes = [style.dash(number) for number in range(len(panel.lines))]
    assert len(set(dashes)) == min(len(dashes), 4) and not style.titled
    assert plot_style(Path("run.pdf")).dash(1) == "-"
    dark = plot_style(Path("run.pdf"), theme="dark")
    assert dark.color((40, 44, 52)) != plot_style(Path("run.pdf")).color((40, 44, 52)) == "#282c34"


def test_a_style_that_has_no_effect_is_refused(recording, tmp_path, capsys):
    page = ["plot", str(recording), "--out", str(tmp_path / "run.html"), "--style", "slide", "--quiet"]
    assert main(page) == 1
    assert "an HTML page is as wide as its window" in capsys.readouterr().err
    assert main(["run", "rod_pendulum", "--time", "0.1", "--theme", "dark", "--quiet"]) == 1
    assert "--theme: nothing is plotted" in capsys.readouterr().err
    with pytest.raises(InputError, match="Did you mean 'slide'"):
        plot_style(Path("run.png"), "slides")


def test_an_html_page_is_self_contained(recording, tmp_path):
    path = tmp_path / "run.html"
    assert main(["plot", str(recording), "--out", str(path), "--show", "joints", "--quiet"]) == 0
    page = path.read_text(encoding="utf-8")
    assert not re.search(r"<script[^>]+src=", page)
    assert len(page) > 1_000_000  # the library is in it
    names = re.findall(r'"name":"(\w+)"', page)
    assert names.count("shoulder") >= 2


def test_plots_without_data_are_reported(recording, tmp_path, capsys):
    arguments = ["plot", str(recording), "--out", str(tmp_path / "run.png"), "--quiet", "--show"]
    assert main([*arguments, "enegies"]) == 1
    assert "Did you mean 'energies'" in capsys.readouterr().err
    bag = foreign_bag(tmp_path / "robot.mcap")
    assert main(["plot", str(bag), "--out", str(tmp_path / "run.png"), "--quiet", "--show", "residual"]) == 1
    assert "contains no data for the plot 'residual'" in capsys.readouterr().err
    for name, remedy in (("reactions", "--reactions"), ("contacts", "--contact-forces")):
        assert main(["plot", str(bag), "--out", str(tmp_path / "run.png"), "--quiet", "--show", name]) == 1
        assert f"no data for the plot '{name}'. Record the run with {remedy}" in capsys.readouterr().err
    assert main(["plot", str(bag), "--out", str(tmp_path / "run.png"), "--quiet"]) == 0


def test_the_options_are_the_styles():
    assert tuple(STYLES) == STYLE_OPTIONS and THEMES == THEME_OPTIONS
    require_names(RUN_PLOTS)


def test_chosen_coordinates_in_degrees(recording, tmp_path, capsys):
    table = read_table(open_recording(recording))
    first = table.names[0]
    plain = panels(table, ["joints", "phase"])
    chosen = panels(table, ["joints", "phase"], [f"{first[:3]}*"], degrees=True)
    names = {line.name for panel in chosen for line in panel.lines}
    assert first in names and names == {name for name in table.names if name.startswith(first[:3])}
    labels = {label for panel in chosen for label in (panel.x_label, panel.y_label)}
    assert {"position (deg)", "velocity (deg/s)", "torque (N·m)"} >= labels - {"time (s)"}
    for panel in chosen[:2]:
        (other,) = (one for one in plain if one.title == panel.title)
        (line,) = (one for one in panel.lines if one.name == first)
        (own,) = (one for one in other.lines if one.name == first)
        assert line.y == pytest.approx(np.degrees(own.y), nan_ok=True) and line.color == own.color
    with pytest.raises(InputError, match="there is no coordinate 'nope'"):
        panels(table, [], ["nope"])
    out = tmp_path / "a.png"
    assert main(["plot", str(recording), "--coordinates", first, "--deg", "--show", "phase", "--out", str(out)]) == 0
    assert main(["run", "double_rod", "--time", "0.01", "--deg", "--quiet"]) == 1
    assert "nothing is plotted" in capsys.readouterr().err


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no device without space")
@pytest.mark.parametrize(("words", "name"), [("plot", "run.svg"), ("plot", "run.html"), ("export", "run.csv")])
def test_a_full_disk_is_told_in_words_without_numbers_of_errors(recording, tmp_path, capsys, words, name):
    (tmp_path / name).symlink_to("/dev/full")
    assert main([words, str(recording), "--out", str(tmp_path / name), "--quiet"]) == 1
    printed = capsys.readouterr().err
    assert "No space left on device" in printed
    assert "Errno" not in printed


@pytest.mark.parametrize(
    ("kept", "title"), [(True, "double_rod: run.mcap, adams11 at 1 ms"), (False, "double_rod, adams11 at 1 ms")]
)
def test_a_title_names_no_recording_that_will_be_gone(tmp_path, monkeypatch, kept, title):
    """Notebooks, and runs without --out, make a recording only for the plot."""
    path, titles = tmp_path / "run.mcap", []
    simulation = Simulation.from_file("double_rod")
    with simulation.recording(path):
        simulation.run(until=0.02)
    monkeypatch.setattr(Figure, "suptitle", lambda _, text: titles.append(text))
    table = read_table(open_recording(path))
    draw(tmp_path / "run.png", table, panels(table, ["energies"]), kept=kept)
    assert titles == [title]
