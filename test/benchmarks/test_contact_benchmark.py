"""The benchmark of contacts: its references are those of the shipped mechanisms, and MuJoCo has the same systems."""

import pytest

from benchmarks import contact_bodies
from benchmarks.contact_models import SYSTEMS, text
from benchmarks.contacts import OPEN, timed_run, without
from mbd_sim import Simulation


@pytest.mark.parametrize("name", ["rocking", "spinning_ball"])
def test_our_errors_are_those_of_round_off(name):
    system, sim = SYSTEMS[name], Simulation.from_file(name)
    total, within, instants = timed_run(sim, system.until)
    assert total > within > 0.0
    assert instants > 0
    assert system.ours(sim.q.tolist()) == pytest.approx(system.q, abs=1e-9)
    assert system.ours(sim.u.tolist()) == pytest.approx(system.u, abs=1e-9)


def test_open_mechanisms_move_as_those_without_contacts():
    with_contacts, plain = (
        Simulation.from_file("elbow_stop", set=OPEN["elbow_stop"]),
        without("elbow_stop", OPEN["elbow_stop"]),
    )
    for sim in (with_contacts, plain):
        sim.step(50)
    assert with_contacts.contact_events == ()
    assert with_contacts.contacts() != {} and plain.contacts() == {}
    assert with_contacts.q == pytest.approx(plain.q, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize("name", SYSTEMS)
def test_mujoco_has_the_same_system(name):
    mujoco = pytest.importorskip("mujoco")
    system = SYSTEMS[name]
    model = mujoco.MjModel.from_xml_string(text(system, chosen=False))
    assert model.nv == len(system.start)
    assert max(system.kept) < model.nv
    assert sum(model.body_mass) == pytest.approx(Simulation.from_file(name).mechanism.mass)


@pytest.mark.parametrize("name", ["stack of four blocks", "grip that slips"])
def test_bodies_of_the_benchmark_end_where_closed_forms_say(name):
    """Ours to round-off, MuJoCo's to millimeters: both are the same scene."""
    scene = contact_bodies.scenes()[name]
    assert contact_bodies.ours(scene)()[1] < 1e-12
    pytest.importorskip("mujoco")
    assert contact_bodies.mujoco(scene, contact_bodies.DEFAULTS)()[1] < 0.03
