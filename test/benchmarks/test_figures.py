"""README.md and docs/benchmarks.md have the figures of one run, which benchmarks/summary.json keeps."""

import json

import pytest

from benchmarks import figures, saved
from benchmarks.engines import OURS
from benchmarks.figures import PAGE, PREFACE, README, SUMMARY, page, with_sentence
from benchmarks.measure import Result
from benchmarks.mechanisms import MECHANISMS
from benchmarks.overview import EULER, RK4, TAYLOR, overview, readme_speed, summary
from benchmarks.report import details
from benchmarks.saved import Measured


@pytest.fixture(scope="module")
def numbers():
    return json.loads(SUMMARY.read_text(encoding="utf-8"))


def test_the_readme_has_the_figures_of_the_summary(numbers):
    text = README.read_text(encoding="utf-8")
    assert with_sentence(text, numbers) == text and readme_speed(numbers) in text


def test_the_page_begins_with_the_overview_of_the_summary(numbers):
    head = PREFACE.read_text(encoding="utf-8").partition("<!-- overview -->")[0]
    assert PAGE.read_text(encoding="utf-8").startswith(head + overview(numbers))
    assert list(numbers["mechanisms"]) == list(MECHANISMS)


def timed(label, each, many, error=1e-13):
    samples = {kind: values for kind, values in (("each", each), ("many", many)) if values}
    step, call = each[1] if each else None, many[1] if many else None
    return Result(label, step, call, 2.0 * step if step else None, error, samples=samples)


def measured(name="2 rods", error=1e-13):
    results = [
        timed(f"{OURS} adams11", [0.1, 0.2, 0.4], [0.1, 0.1, 0.1], error),
        timed(f"{OURS} rk4", [0.1, 0.1, 0.1], [0.1, 0.1, 0.1]),
        timed(EULER, [0.4, 0.4, 0.4], [0.3, 0.3, 0.3], 0.02),
        timed(RK4, [1.0, 0.9, 1.2], [1.0, 1.0, 1.0]),
        timed(TAYLOR, [], [0.05, 0.05, 0.05]),
    ]
    return Measured(
        name,
        f"{OURS} adams11",
        "2026-01-02",
        0.25,
        3,
        0.5,
        ["mbd_sim 1"],
        {"mujoco": 1e-15},
        {"other": "slow"},
        results,
    )


def test_a_summary_has_ratios_of_samples_of_the_same_round():
    found = summary([measured()])["mechanisms"]["2 rods"]
    assert found["method"] == "adams11" and found["step"] == 0.2 and found["commanded"] == 0.4
    assert found["euler_ratio"] == [2.0, 1.5, 3.0] and found["rk4_ratio"] == [10.0, 9.5, 11.0]
    assert found["taylor_ratio"] == [0.5, 0.5, 0.5] and found["taylor"] == 0.05
    series = measured()
    series.results.append(timed(f"{OURS} taylor", [], [0.02, 0.025, 0.025]))
    found = summary([series])["mechanisms"]["2 rods"]
    assert found["free"] == 0.025 and found["taylor_ratio"] == [2.0, 2.0, 2.25]
    assert summary([measured(error=float("inf"))])["mechanisms"]["2 rods"]["error"] is None


def test_an_overview_shows_misses_and_what_is_missing_as_they_are():
    slower, alone = measured("a"), measured("b")
    slower.results[2] = timed(EULER, [0.04, 0.04, 0.04], [0.1, 0.1, 0.1], 0.02)
    alone.results = alone.results[:1]
    lines = overview(summary([slower, alone])).splitlines()
    assert lines[2].split("|")[3:6] == [" 0.04 ", " **0.20** [0.15–0.30] ", " 1e-13 "]
    assert lines[3] == "| b | 0.2 | – | – | 1e-13 | – | – | – | – |"
    assert lines[-1].endswith(
        "Measured on 2026-01-02 with a load of up to 0.2: 3 samples of 0.5 s of simulated time each."
    )


def test_the_sentence_names_the_range_of_ratios_and_errors():
    sentence = readme_speed(summary([measured(), measured("a", 3e-12)]))
    assert "takes 0.2 µs, or 0.4 µs with a new command" in sentence and "On 2 mechanisms" in sentence
    assert "2e-02 to 2e-02 where ours are at most 3e-12" in sentence
    with pytest.raises(ValueError, match="must contain"):
        with_sentence("no marks", summary([measured()]))


def test_saved_results_are_read_as_they_were(tmp_path):
    saved.save(measured(), tmp_path)
    assert saved.load("2 rods", tmp_path) == measured() and saved.load("1 rod", tmp_path) is None
    assert [found.mechanism for found in saved.load_all(["1 rod", "2 rods"], tmp_path)] == ["2 rods"]


def test_a_page_holds_what_was_printed():
    numbers, results = summary([measured()]), details([measured()])
    text = page(
        "# Title\n\n<!-- overview -->\n\n<!-- a -->\n\n<!-- b -->\n", numbers, {"a": "| x |\n", "b": "1 s\n"}, results
    )
    assert "\n| x |\n" in text and "```text\n1 s\n```" in text and overview(numbers) in text
    assert "Not measured (slow): other." in text and "MuJoCo 1e-15" in text
    with pytest.raises(ValueError, match="Run `make bench`"):
        page("<!-- a -->\n", numbers, {}, results)


def test_pages_are_written_only_if_all_mechanisms_are_measured(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(saved, "load_all", lambda names: iter([measured()]))
    assert figures.main() == 1 and "Not measured yet: 1 rod, 7 rods" in capsys.readouterr().err
