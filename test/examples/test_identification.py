"""A mechanism's parameters from a recording of it."""

import dataclasses
import signal

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.examples.identification.excite import multisine
from mbd_sim.examples.identification.identify import identified, main, read
from test.examples.programs import beside, lockstep
from test.waiting import PATIENCE


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    folder = tmp_path_factory.mktemp("identification")
    parameters = lockstep("motor_arm", 100) | {"record": True, "record_dir": str(folder)}
    with beside(folder, parameters, "identification.excite", "duration:=3.0") as experiment:
        assert experiment.program.wait(PATIENCE) == 0
        assert experiment.node.end(signal.SIGINT) == 0
    (path,) = folder.glob("motor_arm_*.mcap")
    return path


def test_the_truth_is_found_from_a_recorded_run(recording, capsys):
    run = read(recording)
    assert len(run.ticks) > 280 and len(run.efforts) > 280
    found = identified([run], {"inertia": 0.02, "damping": 0.06}, 0.5).estimates
    assert found["inertia"].value == pytest.approx(0.015, rel=1e-6)
    assert found["damping"].value == pytest.approx(0.04, rel=1e-6)
    assert main([str(recording), "damping=0.1"]) == 0
    assert "damping" in capsys.readouterr().out
    assert main([str(recording), "dampng=0.1"]) == 1
    assert "Did you mean 'damping'?" in capsys.readouterr().err


def test_several_recordings_are_used_together(recording, capsys):
    assert main([str(recording), str(recording), "damping=0.1"]) == 0
    (line,) = [line for line in capsys.readouterr().out.splitlines() if line.startswith("damping")]
    assert float(line.split()[2]) == pytest.approx(0.04, rel=1e-6)


def test_a_recording_may_begin_under_an_effort(tmp_path):
    simulation = Simulation.from_file("motor_arm")
    simulation.set_efforts([0.5])
    simulation.step(20)
    with simulation.recording(tmp_path / "run.mcap"):
        simulation.step(500)
    run = read(tmp_path / "run.mcap")
    assert [efforts.tolist() for _, efforts in run.efforts] == [[0.5]]
    assert identified([run], {"damping": 0.06}, 0.5).estimates["damping"].value == pytest.approx(0.04, rel=1e-6)


@pytest.mark.parametrize(
    ("words", "problem"),
    [
        (["a.mcap", "b.mcap"], "no guess is given"),
        (["inertia=0.03"], "no recording is given"),
        (["a.mcap", "inertia="], "inertia=: '' is not a positive number"),
        (["a.mcap", "inertia=-1"], "'-1' is not a positive number"),
    ],
)
def test_wrong_words_are_named(words, problem, capsys):
    assert main(words) == 1
    assert problem in capsys.readouterr().err


def test_noise_spoils_it_little(recording):
    run, rng = read(recording), np.random.default_rng(1)
    noisy = dataclasses.replace(
        run, q=run.q + rng.normal(scale=1e-3, size=run.q.shape), u=run.u + rng.normal(scale=5e-3, size=run.u.shape)
    )
    for name, parameter in identified([noisy], {"inertia": 0.016, "damping": 0.038}, 0.5).estimates.items():
        assert parameter.value == pytest.approx({"inertia": 0.015, "damping": 0.04}[name], rel=0.01)
        assert 1e-4 < parameter.error / parameter.value < 0.01


def test_the_excitation_is_rich_and_bounded():
    values = [multisine(0.01 * k, 1.0) for k in range(2000)]
    assert 0.4 < np.std(values) < 1.0
    assert np.max(np.abs(values)) < 3.0
