"""The fuzz of contacts: what counts as faulty, and that a series continues where it ended."""

import dataclasses
import sys

import pytest

from benchmarks import contact_fuzz
from benchmarks.contact_fuzz import STARTS, Found, read, result
from test.generators.body_scenes import SCENES, scene
from test.generators.contact_mechanisms import ALL_KINDS, contact_mechanism


def test_a_series_continues_without_what_is_in_the_file(tmp_path, monkeypatch, capsys):
    path = tmp_path / "results.jsonl"
    command = [
        "contact_fuzz",
        "--runs",
        "1",
        "--time",
        "0.2",
        "--impacts",
        "0",
        "--scenes",
        "0",
        "--results",
        str(path),
    ]
    monkeypatch.setattr(sys, "argv", command)
    contact_fuzz.main()
    first = read(path)
    assert [(found.series, found.seed, found.outcome) for found in first] == [("run", 0, "ended")]
    assert first[0].is_good
    assert "faulty    0" in capsys.readouterr().out
    contact_fuzz.main()
    assert read(path) == first


def test_energies_and_depths_that_are_wrong_are_faults():
    good = Found("run", 1, "box", residual=1e-13, gain=1e-15)
    assert good.is_good
    for wrong in (
        {"residual": 1e-8},
        {"gain": 1e-11},
        {"drift": 1e-9},
        {"residual": float("nan")},
        {"outcome": "crash"},
    ):
        assert not dataclasses.replace(good, **wrong).is_good


def test_a_gain_of_energy_is_found(monkeypatch):
    from mbd_sim.simulation.contact import stepper

    impact = stepper.impact

    def wrong(*arguments):
        found = impact(*arguments)
        return dataclasses.replace(found, u_change=found.u_change * 2.5)

    monkeypatch.setattr(stepper, "impact", wrong)
    monkeypatch.setattr(contact_fuzz, "ENOUGH", 12)
    found = result("loop", 0, 0.3)
    assert found.gain > 1e-3 and not found.is_good


def test_an_exception_is_a_result(monkeypatch):
    monkeypatch.setattr(contact_fuzz, "run", lambda *arguments: 1 / 0)
    found = result("run", 0, 1.0)
    assert (found.outcome, found.message) == ("traceback ZeroDivisionError", "division by zero")


@pytest.mark.parametrize("kind", ALL_KINDS[::3])
def test_the_same_seed_gives_the_same_text(kind):
    assert contact_mechanism(7, kind) == contact_mechanism(7, kind)
    assert contact_mechanism(7, kind) != contact_mechanism(8, kind)


def test_errors_of_integration_are_told_apart_by_a_finer_step(monkeypatch):
    """The gain of the test above stays with any step."""

    def integrated(name, seed, duration, step=1e-3):
        return Found(name, seed, "rotors", outcome="ended", drift=1e6 * step**4 / 8.0**2, step=step)

    monkeypatch.setattr(contact_fuzz, "attempt", integrated)
    monkeypatch.setattr(contact_fuzz, "ELASTIC", 1e-8)
    found = result("loop", 413, 1.0)
    assert found.coarse > 1e-8 > found.drift and found.is_good and found.step == 1.25e-4


@pytest.mark.parametrize("kind", SCENES[::3])
def test_a_scene_has_one_text(kind):
    assert scene(3, kind) == scene(3, kind) != scene(4, kind)


@pytest.mark.parametrize("kind", ["plane_outlines"])
def test_bodies_of_all_shapes_end_with_the_right_energy(kind):
    """Starts of a mechanism: finds hangs, exceptions, penetration and gains of energy. The long series is the program."""
    for start in range(2):
        found = result("scene", STARTS * SCENES.index(kind) + start, 0.3)
        assert found.kind == kind and found.outcome == "ended" and found.is_good, found
