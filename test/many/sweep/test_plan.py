"""Plans of sweeps: what is varied, how it is combined, and what is read from each run."""

import numpy as np
import pytest

from mbd_sim import MbdSimError, Simulation
from mbd_sim.base.errors import CommandError
from mbd_sim.files.checks.override import with_values
from mbd_sim.files.load import load_mechanism
from mbd_sim.many.sweep.plan import (
    STATISTICS,
    Grid,
    Random,
    column_names,
    named_quantities,
    plan,
    quantities,
    variation,
)
from mbd_sim.many.sweep.runs import Settings, chunks, compute, result_names
from mbd_sim.simulation.contact.records import ContactChange


@pytest.fixture(scope="module")
def rods():
    return load_mechanism("double_rod")


def test_variations_are_read_with_units(rods):
    assert variation("l=0.5:2:4", rods) == Grid("l", (0.5, 1.0, 1.5, 2.0))
    assert variation("joints.elbow.position = 0 deg, 180 deg", rods) == Grid("joints.elbow.position", (0.0, np.pi))
    assert variation("m=uniform(500 g, 2*m)", rods) == Random("m", "uniform", 0.5, 2.0)
    assert variation("efforts.elbow=1e0", rods) == Grid("efforts.elbow", (1.0,))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("l", "gives no values"),
        ("l=", "gives no values"),
        ("l=1:2", "START:STOP:COUNT"),
        ("l=1:2:x", "the number of values cannot be 'x'"),
        ("l=a,b", "'a': .*unknown"),
        ("l=gauss(1, 2)", "no distribution 'gauss'"),
        ("l=uniform(1)", "low, high"),
        ("joints.elbow.damping=0.1,1 kg", "'1 kg': the unit 'kg' does not fit"),
        ("joints.elbow.position=uniform(1 m, 2 m)", "the unit 'm' does not fit"),
        ("efforts.elbow=0,3 N", r"'3 N': the unit 'N' does not fit: a value in N\*m is expected here"),
        ("l=uniform(2, 1)", "uniform needs low <= high"),
        ("l=uniform(0, inf)", "must be finite"),
        ("l=loguniform(-1, 2)", "0 < low"),
        ("l=loguniform(0, 2)", "0 < low"),
        ("l=normal(1, -2)", "must not be negative"),
        ("joints.elbw.damping=1", "elbow"),
        ("joints.elbow.type=1", "not a number"),
        ("efforts.elbw=1", "no joint 'elbw'"),
    ],
)
def test_the_error_for_a_value_that_cannot_be_varied_says_why(rods, text, words):
    with pytest.raises(CommandError, match=words):
        variation(text, rods)


def test_a_plan_has_every_combination_with_new_random_values(rods):
    planned = plan(
        [Grid("l", (1.0, 2.0)), Random("m", "uniform", 0.0, 1.0), Grid("k", (3.0, 4.0, 5.0))], draws=2, seed=1
    )
    assert planned.names == ("l", "m", "k")
    assert planned.values.shape == (12, 3)
    assert planned.values[:, 0].tolist() == [1.0] * 6 + [2.0] * 6
    assert planned.values[:6, 2].tolist() == [3.0, 3.0, 4.0, 4.0, 5.0, 5.0]
    assert len(set(planned.values[:, 1])) == 12
    assert np.array_equal(
        planned.values,
        plan([Grid("l", (1.0, 2.0)), Random("m", "uniform", 0.0, 1.0), Grid("k", (3.0, 4.0, 5.0))], 2, 1).values,
    )
    assert planned.changes(3, 4) == [dict(zip(planned.names, planned.values[3], strict=True))]


def test_laws_draw_what_they_say():
    drawn = plan([Random("a", "normal", 2.0, 0.5), Random("b", "loguniform", 1.0, 100.0)], draws=20_000).values
    assert drawn[:, 0].mean() == pytest.approx(2.0, abs=0.02)
    assert drawn[:, 0].std() == pytest.approx(0.5, abs=0.02)
    assert np.log10(drawn[:, 1]).mean() == pytest.approx(1.0, abs=0.02)
    assert drawn[:, 1].min() >= 1.0
    assert drawn[:, 1].max() <= 100.0


def test_a_plan_is_not_too_large_and_varies_nothing_twice():
    for other in ("l", "parameters.l"):
        with pytest.raises(CommandError, match="l is varied twice"):
            plan([Grid("l", (1.0,)), Grid(other, (2.0,))])
    with pytest.raises(CommandError, match="the number of runs must be"):
        plan([Grid("l", (1.0,) * 5000), Grid("m", (1.0,) * 5000)])
    with pytest.raises(CommandError, match="the number of runs must be"):
        plan([Grid("l", (1.0,))], draws=0)


def swept(name, changes, wanted, until=0.1, every=0.01):
    source = load_mechanism(name).source
    settings = Settings(source.text, source.file, until=until, every=every, quantities=tuple(wanted))
    return compute(settings, chunks(changes)[0]).runs


def statistics(values):
    return [values[-1], np.min(values), np.max(values), np.sqrt(np.mean(np.square(values)))]


def test_loads_points_and_energies_are_those_of_single_runs():
    wanted = {
        "reactions.elbow.force": lambda sim: np.linalg.norm(sim.reactions()["elbow"].force),
        "reactions.shoulder.force.z": lambda sim: sim.reactions()["shoulder"].force[2],
        "points.lower.x": lambda sim: sim.poses()["lower"].position[0],
        "points.lower.speed": lambda sim: np.linalg.norm(sim.motion("lower").velocity),
        "points.lower.acceleration": lambda sim: np.linalg.norm(sim.motion("lower").acceleration),
        "energies.kinetic": lambda sim: sim.energies.kinetic,
        "velocities.elbow": lambda sim: sim.u[1],
    }
    changes = [{"l": 0.7}, {"l": 1.3}]
    found = swept("double_rod", changes, wanted)
    for row, change in enumerate(changes):
        sim = Simulation(with_values(load_mechanism("double_rod"), change))
        seen = {name: [read(sim)] for name, read in wanted.items()}
        for _ in range(10):
            sim.step(10)
            for name, read in wanted.items():
                seen[name].append(read(sim))
        for name, values in seen.items():
            row_of = [found[f"{name}.{statistic}"][row] for statistic in STATISTICS]
            assert row_of == pytest.approx(statistics(values), rel=1e-9, abs=1e-9)


def test_drives_are_those_of_a_single_run():
    found = swept("rotating_frame_mass", [{}], quantities(load_mechanism("rotating_frame_mass")))
    sim = Simulation.from_file("rotating_frame_mass")
    (name,) = sim.mechanism.driven_names
    forces = [sim.drives()[name].force]
    for _ in range(10):
        sim.step(10)
        forces.append(sim.drives()[name].force)
    assert [found[f"drives.{name}.force.{statistic}"][0] for statistic in STATISTICS] == pytest.approx(
        statistics(forces), rel=1e-9, abs=1e-12
    )


def test_events_at_contacts_are_counted_and_their_losses_known():
    sim, impacts = Simulation.from_file("bounce"), 0
    while sim.time < 1.9995:
        before = len(sim.contact_events)
        sim.step()
        impacts += sum(event.change is ContactChange.IMPACT for event in sim.contact_events[before:])
    found = swept("bounce", [{}, {}], ["events.impact", "losses.impact"], until=2.0, every=0.1)
    assert impacts > 1 and found["events.impact"].tolist() == [impacts] * 2
    assert found["losses.impact.final"] == pytest.approx([sim.losses.impact] * 2)
    assert found["losses.impact.least"].tolist() == [0.0, 0.0]


def test_names_are_listed_and_a_wrong_one_is_refused():
    mechanism = load_mechanism("four_bar")
    assert {"reactions.crank_pivot.force", "energies.residual", "events.impact"} <= quantities(mechanism).keys()
    assert column_names(["energies.total", "events.impact"])[:2] == ["energies.total.final", "energies.total.least"]
    assert result_names(mechanism, ["events.impact"])[-1] == "events.impact"
    with pytest.raises(MbdSimError, match=r"no quantity 'energies\.kinetik'\. Did you mean 'energies\.kinetic'"):
        named_quantities(mechanism, ["energies.kinetik"])
