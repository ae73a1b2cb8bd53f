"""Lengths in closed loops that change during a run: the mechanism is assembled anew from where it is.

The expected configurations and speeds are found without the engine: with the places of points, and with the conditions
of the least change.
"""

import numpy as np
import pytest
from scipy.linalg import null_space
from scipy.spatial.transform import Rotation

from mbd_sim import Simulation
from mbd_sim.base.errors import CommandError
from mbd_sim.recordings.run.verification import verify

LENGTHS = {"crank": 0.5, "coupler": 1.4, "rocker": 1.2}
LIVE = tuple(f"parameters.{name}" for name in LENGTHS)


def linkage(unit=1.0, turn=None, stop=""):
    """A four-bar linkage in any plane and unit of length, as text."""
    turn = Rotation.identity() if turn is None else turn

    def vector(*values):
        return turn.apply(values).tolist()

    x, normal = vector(1.0, 0.0, 0.0), vector(0.0, 0.0, 1.0)
    along = {name: [f"{name}*{component!r}" for component in x] for name in LENGTHS}
    parts = "".join(
        f"  {name}: {{mass: 1, center: {[f'{text}/2' for text in along[name]]}, inertia: {[1e-3 * unit**2] * 3},"
        f" points: {{tip: {along[name]}}}}}\n"
        for name in LENGTHS
    )
    joints = {
        "crank_pivot": ("ground", "crank", "position: 1.5, velocity: 2"),
        "crank_pin": ("crank.tip", "coupler", "position: -1.1, guess: true"),
        "rocker_pivot": ("ground.pivot", "rocker", f"position: 1.7, guess: true{stop}"),
        "rocker_pin": ("coupler.tip", "rocker.tip", ""),
    }
    loop = "".join(
        f"  {name}: {{type: revolute, between: [{a}, {b}], axis: {normal}, {rest}}}\n"
        for name, (a, b, rest) in joints.items()
    )
    lengths = {name: value * unit for name, value in LENGTHS.items()}
    return (
        f"mechanism: linkage\nparameters: {lengths}\nground: {{points: {{pivot: {vector(1.5 * unit, 0.0, 0.0)}}}}}\n"
        f"gravity: {(unit * np.array(vector(0.0, -9.81, 0.0))).tolist()}\nparts:\n{parts}joints:\n{loop}"
    )


@pytest.fixture(scope="module")
def plain():
    return Simulation.from_text(linkage(), live=LIVE)


def mode(sim):
    """The side of the diagonal on which the pin between coupler and rocker is: the way of assembling the linkage."""
    tip, pin, pivot = (sim.point(name).position for name in ("crank.tip", "coupler.tip", "rocker"))
    return np.sign(np.cross(pin - tip, pivot - tip).sum())


def kinetic(sim, change):
    return 0.5 * change @ sim.mass_matrix() @ change


@pytest.mark.parametrize("seed", [0])
def test_the_loops_are_closed_with_speeds_of_least_change_and_the_account_is_told(seed):
    """In any plane, from 1 mm to 1 km: with other lengths by up to a quarter, at another moment of the motion."""
    random = np.random.default_rng(seed)
    unit, turn = float(10.0 ** random.integers(-3, 4)), Rotation.random(random_state=seed)
    sim = Simulation.from_text(linkage(unit, turn), live=LIVE, step=5e-4 * np.sqrt(unit))
    sim.step(int(random.integers(1, 400)))
    residual, u, side, steps = sim.energies.residual, sim.u.copy(), mode(sim), sim.steps
    lengths = {f"parameters.{name}": LENGTHS[name] * unit * random.uniform(0.75, 1.25) for name in LENGTHS}
    sim.set_live(lengths, reassemble=True)
    gap = sim.point("coupler.tip").position - sim.point("rocker.tip").position
    assert np.abs(gap).max() < 1e-12 * unit and sim.steps == steps and sim.live == lengths
    for name in LENGTHS:
        place = sim.point(f"{name}.tip").position - sim.point(name).position
        assert np.linalg.norm(place) == pytest.approx(lengths[f"parameters.{name}"], rel=1e-12)
    assert mode(sim) == side
    free = null_space(sim.constraint_jacobian(), rcond=1e-9)
    assert free.shape[1] == 1
    size = np.abs(u).max()
    assert np.abs(sim.constraint_jacobian() @ sim.u).max() < 1e-11 * size * unit
    # any other speeds that the loop allows differ from those before by more energy
    for other in (-1e-3, 1e-3):
        assert kinetic(sim, sim.u + other * size * free[:, 0] - u) > kinetic(sim, sim.u - u)
    assert sim.energies.residual == pytest.approx(residual, abs=1e-12 * abs(sim.energies.total))
    sim.step(100)
    assert abs(sim.energies.residual) < 1e-9 * abs(sim.energies.total)


def test_the_configuration_is_the_nearest_one(plain):
    """For a small change, the step of all angles is perpendicular to the motion that the loop allows."""
    sim = plain.copy()
    sim.step(100)
    before, small = sim.q.copy(), 1e-4
    sim.set_live({"parameters.coupler": 1.4 + small}, reassemble=True)
    moved = sim.q - before
    assert np.linalg.norm(moved) > 0.1 * small
    assert abs(null_space(sim.constraint_jacobian())[:, 0] @ moved) < 10.0 * small**2


def test_a_length_can_change_until_the_linkage_is_stretched_and_no_further(plain):
    """The crank reaches over the three other bars at most."""
    limit = 1.5 + 1.4 + 1.2
    sim = plain.copy()
    sim.set_live({"parameters.crank": limit - 1e-3}, reassemble=True)
    assert sim.violation.position < 1e-12
    kept = sim.snapshot()
    with pytest.raises(
        CommandError, match=r"from this configuration the loops can be closed only up to about .*crank = (4\.\d+)"
    ) as caught:
        sim.set_live({"parameters.crank": 6.0}, reassemble=True)
    assert float(str(caught.value).split("crank = ")[1].split(". ")[0]) == pytest.approx(limit, abs=1e-3)
    after = sim.snapshot()
    assert (after.state.tobytes(), after.inputs.tobytes(), after.live) == (
        kept.state.tobytes(),
        kept.inputs.tobytes(),
        kept.live,
    )


def test_without_the_request_a_change_is_refused_with_it_as_the_remedy(plain):
    sim = plain.copy()
    with pytest.raises(CommandError, match=r"would open the loops by 0\.\d+\. .*reassemble=True"):
        sim.set_live({"parameters.crank": 0.6})


def test_a_change_that_opens_no_loop_is_the_same_with_and_without_the_request():
    first = Simulation.from_file("four_bar", live=["gravity[2]", "parameters.density"])
    first.step(100)
    second = first.copy()
    first.set_live({"gravity[2]": -3.0, "parameters.density": 1.3})
    second.set_live({"gravity[2]": -3.0, "parameters.density": 1.3}, reassemble=True)
    for sim in (first, second):
        sim.step(50)
    assert first.state.tobytes() == second.state.tobytes()


def test_a_stop_is_not_passed():
    sim = Simulation.from_text(linkage(stop=", limits: {lower: 1, upper: 2.5, restitution: 0}"), live=LIVE)
    with pytest.raises(CommandError, match=r"joints\.rocker_pivot\.limits: the joint is .* beyond its"):
        sim.set_live({"parameters.coupler": 2.2}, reassemble=True)
    assert sim.live["parameters.coupler"] == 1.4 and sim.violation.position < 1e-12


def test_a_recording_with_many_changes_of_lengths_recomputes_bit_for_bit(tmp_path):
    sim, random = Simulation.from_text(linkage(), live=LIVE), np.random.default_rng(1)
    refused = 0
    with sim.recording(tmp_path / "run.mcap"):
        for _ in range(5):
            sim.step(int(random.integers(1, 30)))
            try:
                name = random.choice(list(LENGTHS))
                sim.set_live({f"parameters.{name}": LENGTHS[name] * random.uniform(0.3, 2.5)}, reassemble=True)
            except CommandError:
                refused += 1
        sim.step(20)
    (found,) = verify(tmp_path / "run.mcap")
    assert found.agrees and found.tolerance is None and not found.problem
    assert found.commands["live_values"] == 5 - refused > 2
