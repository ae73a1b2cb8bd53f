"""Slots that many pairs share: the motion is that with slots for each pair, whatever pair a slot has at a time."""

import math

import numpy as np
import pytest

from mbd_sim import Ensemble, Simulation
from mbd_sim.base.errors import DivergedError, InputError
from mbd_sim.dynamics.contact.rows import pools
from mbd_sim.files.load import parse_mechanism

BLOCK = "shape: {type: block, size: [0.1, 0.12, 0.08], mass: 0.4}"
SHAPES = (BLOCK, "shape: {type: capsule, length: 0.08, radius: 0.03, mass: 0.2}", BLOCK, BLOCK)


def heap(name, seed=1, shapes=SHAPES, turned=True):
    """Bodies that fall on each other and on a plane; a massless link holds two of them."""
    random = np.random.default_rng(seed)
    parts, joints, places = [], [], []
    for k, shape in enumerate(shapes):
        places.append((*random.uniform(-0.03, 0.03, 2).tolist(), 0.12 + 0.16 * k))
        angle = (
            0 if k in (0, 2) or not turned else random.uniform(5, 40)
        )  # the link connects points that are alike in both
        turn = f"{{axis: {random.normal(size=3).tolist()}, angle: {angle} deg}}"
        parts.append(f"  b{k}: {{{shape}, points: {{end: [0.01, 0, 0.02]}}}}")
        joints.append(
            f"  b{k}: {{type: free, between: [ground, b{k}], position: {list(places[k])}, "
            f"orientation: {turn}, velocity: [0, 0, {0 if k in (0, 2) else -0.5}]}}"
        )
    return "\n".join([
        f"mechanism: {name}",
        "parts:",
        *parts,
        "joints:",
        *joints,
        "contacts:",
        "  bodies: {among: all, friction: 0.3, restitution: 0}",
        "  floor: {parts: all, plane: ground, friction: 0.4}",
        f"constraints: {{link: {{type: distance, between: [b0.end, b2.end], length: {math.dist(places[0], places[2])!r}}}}}",
        "integrator: {method: adams11, step: 1 ms}",
    ])  # fmt: skip


def shared(monkeypatch, name="shared", method=None, **options):
    monkeypatch.setattr(pools, "OWN_ROWS", 0)
    return Simulation.from_text(heap(name, **options), method=method)


def own(monkeypatch, name="own", method=None, **options):
    monkeypatch.setattr(pools, "OWN_ROWS", 10**6)
    return Simulation.from_text(heap(name, **options), method=method)


def step_to_contact(sim):
    while not any(name.startswith("bodies") and state.normal > 0 for name, state in sim.contacts().items()):
        assert sim.time < 0.4
        sim.step(1)


@pytest.mark.parametrize(("method", "accuracy"), [("adams11", 1e-12), ("moreau", 1e-10)])
def test_motion_is_that_with_slots_for_each_pair(monkeypatch, method, accuracy):
    """Any row that acts on the parts of another pair, or friction that does not follow its gap."""
    one, other = own(monkeypatch, method=method), shared(monkeypatch, method=method)
    assert other.model.one_sided.layout.pooled and not one.model.one_sided.layout.pooled
    met = set()
    for _ in range(16):
        one.step(10)
        other.step(10)
        touching = {state.bodies for state in other.contacts().values() if state.bodies}
        met |= touching
        apart = {name for name, state in one.contacts().items() if name.startswith("bodies") and state.state != "open"}
        assert len(apart) == sum(state.bodies is not None for state in other.contacts().values())
    assert len(met) >= 2
    assert np.max(np.abs(one.q - other.q)) < accuracy and np.max(np.abs(one.u - other.u)) < 100 * accuracy


def test_what_is_read_follows_the_pairs(monkeypatch):
    """Forces that act on other parts than those of the slot in readings, or a place of another pair."""
    one, other = own(monkeypatch), shared(monkeypatch)
    for sim in (one, other):
        step_to_contact(sim)
    assert one.time == other.time
    size = np.max(np.abs(one.u_rates))
    assert np.max(np.abs(one.u_rates - other.u_rates)) < 1e-9 * size
    for name in one.multipliers():
        assert np.allclose(one.multipliers()[name], other.multipliers()[name], atol=1e-9, rtol=1e-9)
    bodies = [state for name, state in other.contacts().items() if state.bodies]
    pairs = [state for name, state in one.contacts().items() if name.startswith("bodies") and state.state != "open"]
    order = {tuple(np.round(state.point, 6)): state for state in pairs}
    for state in bodies:
        known = order[tuple(np.round(state.point, 6))]
        assert np.allclose(state.force, known.force, atol=1e-9, rtol=1e-9) and np.allclose(
            state.direction, known.direction
        )


def test_snapshots_keep_the_pairs_of_slots(monkeypatch):
    """A state that is restored without the pairs to which its slots belong."""
    sim = shared(monkeypatch)
    step_to_contact(sim)
    kept, copy = sim.snapshot(), sim.copy()
    sim.step(40)
    expected = sim.y.copy()
    sim.restore(kept)
    sim.step(40)
    copy.step(40)
    assert np.array_equal(sim.y, expected) and np.array_equal(copy.y, expected)


def test_open_slots_have_the_distance_of_the_nearest_pair(monkeypatch):
    sim = shared(monkeypatch)
    for _ in range(12):
        gaps = {state.gap for name, state in sim.contacts().items() if name.startswith("bodies")}
        pairs = sim.model.one_sided.features
        poses = pairs._poses(sim.time, sim.y, sim.inputs)
        exact = [pair.phase.distance(*pair.poses(poses)) for pair in pairs.pairs if pair.holders is not None]
        (gap,) = gaps
        assert gap <= min(exact) + 1e-15 and (gap > 0.0) == (min(exact) > 0.0)
        sim.step(5)


def test_events_name_the_pair(monkeypatch):
    sim = shared(monkeypatch)
    step_to_contact(sim)
    names = {event.name for event in sim.contact_events if event.name.startswith("bodies")}
    assert names and all("_on_" in name for name in names)


def few(monkeypatch):
    """A stack whose bodies touch in more points than the slot of its pool."""
    monkeypatch.setattr(pools, "SOLIDS", 1)
    monkeypatch.setattr(pools, "MOST_ROWS", 3)
    return shared(monkeypatch, name="few", shapes=(BLOCK, BLOCK, BLOCK), turned=False)


@pytest.mark.parametrize("seed", range(6))
def test_all_pools_together_have_no_more_rows_than_possible(monkeypatch, seed):
    """A bound of each entry of the file, of which many have any number of rows; an error that names one of them."""
    random = np.random.default_rng(seed)
    groups = {f"g{k}": [f"g{k}b{n}" for n in range(size)] for k, size in enumerate(random.integers(2, 12, 4).tolist())}
    bodies = [body for group in groups.values() for body in group]
    mechanism = parse_mechanism("\n".join([
        "mechanism: groups",
        "parts:",
        *(f"  {body}: {{{BLOCK}}}" for body in bodies),
        "joints:",
        *(f"  {body}: {{type: free, between: [ground, {body}]}}" for body in bodies),
        "contacts:",
        *(f"  {name}: {{among: [{', '.join(group)}], friction: {random.integers(2)}}}" for name, group in groups.items()),
    ]))  # fmt: skip
    monkeypatch.setattr(pools, "OWN_ROWS", 0)

    def found(most):
        monkeypatch.setattr(pools, "MOST_ROWS", most)
        return pools.pooled(mechanism.contacts, mechanism)[1]

    rows = [3 if pool.pairs[0].law.static_friction else 1 for pool in found(10**6)]
    wanted = [pool.slots for pool in found(10**6)]
    needed = int(np.dot(rows, wanted))
    assert [pool.slots for pool in found(needed)] == wanted
    for most in (needed - 1, needed // 2, needed // 5):
        bounded = found(most)
        assert needed / 6 < np.dot(rows, [pool.slots for pool in bounded]) <= most
        for pool in bounded:
            assert all(name in pool.lacking.message for name in groups) and pool.lacking.key == f"contacts.{pool.name}"


def test_more_points_than_slots_are_refused(monkeypatch):
    """Bodies that pass through each other without a word because no slot is left; an error that does not say where."""
    sim = few(monkeypatch)
    with pytest.raises(
        DivergedError, match=r":11: contacts\.bodies: bodies touch in more than 1 point at once.*\. Name the pairs"
    ):
        sim.step(400)


def test_a_member_with_more_points_than_slots_is_lost_alone(monkeypatch):
    """One member that ends the run of all others."""
    ensemble = Ensemble(few(monkeypatch).model.mechanism, 2)
    q, u = ensemble.q.copy(), ensemble.u.copy()
    q[1, 2::7] += 10.0
    u[1] = 0.0  # its bodies fall together, and do not touch
    ensemble.reset(q, u)
    ensemble.step(400)
    assert ensemble.alive.tolist() == [False, True]
    with pytest.raises(DivergedError, match=r"member 0.*more than 1 point at once"):
        ensemble.require_alive()


def test_what_needs_equations_of_the_rows_says_so(monkeypatch):
    sim = shared(monkeypatch, name="linear")
    step_to_contact(sim)
    with pytest.raises(InputError, match=r"contacts 'bodies': the 6 pairs share their slots"):
        sim.linearize()
