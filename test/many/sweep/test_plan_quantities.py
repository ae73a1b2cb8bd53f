"""Quantities of a sweep: the same numbers as those of single simulations, and their statistics."""

import numpy as np
import pytest

from mbd_sim import MbdSimError, Simulation
from mbd_sim.files.checks.override import with_values
from mbd_sim.files.load import load_mechanism
from mbd_sim.many.sweep.plan import STATISTICS, column_names, named_quantities, quantities
from mbd_sim.many.sweep.runs import Settings, chunks, compute, result_names
from mbd_sim.simulation.contact.records import ContactChange


def swept(name, changes, wanted, until=0.1, every=0.01, method=None):
    source = load_mechanism(name).source
    settings = Settings(source.text, source.file, until=until, every=every, method=method, quantities=tuple(wanted))
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


def test_a_run_that_cannot_be_built_has_nan_there_too():
    mechanism = load_mechanism("four_bar")
    key = next(iter(mechanism.parameters))
    runs = [{key: mechanism.parameters[key]}, {key: 1e3}]
    found = swept("four_bar", runs, ["energies.total"], until=0.02, method="rk4")
    assert np.isfinite(found["energies.total.rms"]).tolist() == [True, False]
