"""Joints, springs, constraints, forces and plots, read back with Rerun's reader and compared with the simulation."""

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.base.geometry import rotation as rot
from mbd_sim.pictures.rerun.loads import loads
from mbd_sim.pictures.rerun.scene import DisplayOptions, PartPoses, RowMaker, Rows, describe_scene, weight
from mbd_sim.pictures.shapes import palette
from mbd_sim.pictures.shapes.extent import extent_of
from mbd_sim.pictures.shapes.joints import LONG
from mbd_sim.pictures.shapes.palette import residual_magnitude
from mbd_sim.pictures.shapes.touching import ForceScale
from test.pictures.rerun.test_viewer import Recorded
from test.simulation.contact.test_contact_forces import SOFT_BALL

TIED = """
mechanism: tied
parts:
  bob: {mass: 2 kg, shape: {type: sphere, radius: 0.1}, points: {top: [0, 0, 0.1]}}
joints: {slide: {type: prismatic, between: [ground, bob], axis: [0, 0, 1], position: -1.0}}
ground: {points: {hook: [0.3, 0, 0]}}
forces:
  spring: {type: spring, between: [ground.hook, bob.top], stiffness: 40, length: 0.5, damping: 2}
  push: {type: force, at: bob.top, vector: ["3*sin(4*t)", 0, 0]}
"""


def show(sim, tmp_path, options=None, seconds=0.4, each=10, read=lambda: None):
    """Run, show, and read back; also returns the poses and reactions of `sim` at each sample. `read` is called then."""
    from mbd_sim.pictures.rerun.stream import RerunStream

    path, options = tmp_path / "a.rrd", options or DisplayOptions()
    writer = RowMaker(sim.model, options.reactions)
    scene = describe_scene(sim.model, writer.layout, options)
    stream = RerunStream(scene, str(path))
    rows, moments = [], []
    while sim.time <= seconds:
        rows.append(writer.row(sim.time, sim.time, sim.state, sim.inputs.copy(), sim.energies))
        moments.append((sim.time, sim.poses(), sim.reactions() if options.reactions else None))
        read()
        sim.step(each)
    half = len(rows) // 2
    for batch in (rows[:half], rows[half:]):  # in two batches
        stream.send_samples(np.array(batch))
    stream.flush()
    stream.close()
    return Recorded(path), moments, scene


def static_color(recorded, entity):
    (values,) = [value for key, value in recorded.static[entity].items() if key.endswith("colors")]
    return (values[0][0] >> 24, values[0][0] >> 16 & 255, values[0][0] >> 8 & 255)


def test_a_coil_reaches_from_end_to_end_with_its_damper_in_the_middle(tmp_path):
    sim = Simulation.from_text(TIED)
    recorded, moments, _ = show(sim, tmp_path)
    entity = "/world/springs/spring"
    starts = recorded.column(entity, "Transform3D:translation")[:, 0]
    scales = recorded.column(entity, "Transform3D:scale")[:, 0]
    turns = recorded.column(entity, "Transform3D:quaternion")[:, 0]
    middles = recorded.column("/world/dampers/spring/cylinder", "Transform3D:translation")[:, 0]
    coil = np.array(recorded.static[f"{entity}/coil"]["LineStrips3D:strips"][0][0])
    np.testing.assert_allclose([coil[0], coil[-1]], [[0, 0, 0], [0, 0, 1]], atol=1e-6)
    assert len(starts) == len(moments)
    for (_, poses, _), start, scale, xyzw, middle in zip(moments, starts, scales, turns, middles, strict=True):
        top = poses["bob"].position + np.array([0.0, 0.0, 0.1])
        end = start + rot.from_quaternion(np.roll(xyzw, 1)) @ (scale * coil[-1])
        np.testing.assert_allclose(start, [0.3, 0.0, 0.0], atol=1e-6)
        np.testing.assert_allclose(end, top, atol=1e-5)
        np.testing.assert_allclose(middle, (start + top) / 2.0, atol=1e-5)


def test_arrows_of_applied_forces_follow_their_expressions(tmp_path):
    recorded, moments, scene = show(Simulation.from_text(TIED), tmp_path)
    entity = "/world/forces/push/force"
    times = recorded.times(entity)
    drawn = {}
    for time, row in recorded.rows[entity]:
        vectors = row["Arrows3D:vectors"]
        drawn[round(time, 6)] = vectors[0] if vectors else np.zeros(3)
    assert drawn[0.0] @ np.ones(3) == 0.0  # nothing is drawn rather than an arrow of length zero
    for time in times:
        expected = LONG * scene.extent.size * np.sin(4.0 * time)
        np.testing.assert_allclose(drawn[round(time, 6)], [expected, 0.0, 0.0], rtol=2e-3, atol=2e-3)
    assert len(times) == len(moments)


def test_reactions_efforts_and_wrenches_are_arrows_to_scale(tmp_path):
    sim = Simulation.from_file("double_rod", wrenches=["lower"])
    sim.set_efforts({"elbow": 2.0})
    sim.set_wrench("lower", force=(3.0, 0.0, -4.0), at="tip" if "tip" in sim.mechanism.parts["lower"].points else None)
    recorded, moments, scene = show(sim, tmp_path, DisplayOptions(reactions=True))
    size = LONG * scene.extent.size / weight(scene)
    vectors = recorded.column("/world/reactions/elbow/force", "Arrows3D:vectors")[:, 0]
    expected = np.array([reactions["elbow"].force for _, _, reactions in moments])
    short = np.linalg.norm(expected, axis=1) * size < 0.6 * scene.extent.size
    assert np.count_nonzero(short) > 10
    np.testing.assert_allclose(vectors[short], size * expected[short], rtol=1e-5, atol=1e-6)
    magnitudes = recorded.column("/joints/reaction", "Scalars:scalars")
    np.testing.assert_allclose(magnitudes[:, 1], np.linalg.norm(expected, axis=1), rtol=1e-12)
    wrench = recorded.column("/world/wrenches/lower/force", "Arrows3D:vectors")[:, 0]
    np.testing.assert_allclose(wrench, np.tile(size * np.array([3.0, 0.0, -4.0]), (len(moments), 1)), rtol=1e-5)
    arcs = recorded.column("/world/efforts/elbow/couple", "LineStrips3D:strips")[:, 0]
    radii = np.linalg.norm(arcs[:, :25] - moments[0][1]["lower"].position, axis=2)[0]
    assert np.ptp(radii) < 1e-4


def test_driven_and_loop_closing_joints_differ_in_color(tmp_path):
    recorded, _, scene = show(Simulation.from_file("scissor_lift"), tmp_path, seconds=0.05)
    mechanism = scene.mechanism
    found = {
        name: static_color(
            recorded, f"/world/{'ground' if joint.parent == 'ground' else f'parts/{joint.parent}'}/joints/{name}"
        )
        for name, joint in mechanism.all_joints.items()
    }
    driven = {name for name, joint in mechanism.joints.items() if joint.drive}
    assert driven
    assert mechanism.closing
    for name, color in found.items():
        if name in driven:
            assert color == palette.DRIVEN
        elif name in mechanism.closing:
            assert color == palette.CLOSING
        else:
            assert color in (palette.STEEL, palette.JOINT)


def test_a_wheel_touches_its_plane_below_its_center(tmp_path):
    recorded, moments, scene = show(Simulation.from_file("rolling_disc"), tmp_path)
    (rolling,) = scene.mechanism.constraints
    touched = recorded.column(f"/world/contacts/{rolling.name}", "Points3D:positions")[:, 0]
    heights = (touched - rolling.plane.point) @ rolling.normal
    np.testing.assert_allclose(heights, 0.0, atol=1e-6)
    centers = [poses[rolling.center.part] for _, poses, _ in moments]
    arms = touched - [pose.position + pose.rotation @ rolling.center.point for pose in centers]
    np.testing.assert_allclose(np.linalg.norm(arms, axis=1), rolling.radius, rtol=1e-5)
    track = recorded.column(f"/world/traces/{rolling.name}", "LineStrips3D:strips")[:, 0]
    np.testing.assert_allclose(track[1:, 0], touched[:-1], atol=1e-6)


def test_a_cable_runs_through_its_points(tmp_path):
    recorded, moments, scene = show(Simulation.from_file("swinging_atwood"), tmp_path)
    (cable,) = scene.mechanism.constraints
    strips = recorded.column(f"/world/constraints/{cable.name}", "LineStrips3D:strips")[:, 0]
    assert strips.shape == (len(moments), len(cable.points), 3)
    lengths = np.linalg.norm(np.diff(strips, axis=1), axis=2).sum(axis=1)
    np.testing.assert_allclose(lengths, cable.length.at(0.0), rtol=1e-5)


def test_a_curve_lies_on_its_surfaces_and_passes_through_the_bead(tmp_path):
    sim = Simulation.from_file("bead_on_wire")
    recorded, _, scene = show(sim, tmp_path, seconds=0.05)
    (wires,) = scene.wires
    (entity,) = [path for path in recorded.static if "/wires/" in path]
    strips = recorded.static[entity]["LineStrips3D:strips"][0]
    assert sum(len(strip) for strip in strips) == sum(len(line) for line in wires.form.strips) > 20
    bead = scene.at_start(scene.mechanism.constraints[0].point)
    assert min(np.linalg.norm(np.array(strip) - bead, axis=1).min() for strip in strips) < 0.05 * scene.extent.size


def test_the_travel_of_a_slide_is_found(tmp_path):
    sim = Simulation.from_file("slider_crank")
    extent = extent_of(sim.model)
    (name,) = [name for name, joint in sim.mechanism.all_joints.items() if joint.type == "prismatic"]
    low, high = extent.travel[name]
    assert high - low > 0.1 * extent.size


def test_the_residual_is_not_smaller_than_the_rounding_error_of_its_terms():
    audit = np.array([[10.0, -4.0, 0.0, 0.0, 0.0, 6.0, 0.0], [10.0, -4.0, 0.0, 0.0, 0.0, 6.0, -1e-9], [0.0] * 7])
    np.testing.assert_allclose(residual_magnitude(audit), [5.0 * np.finfo(float).eps, 1e-9, 1e-18])


@pytest.mark.parametrize("name", ["follower_force", "driveline", "insect_on_sphere"])
def test_scenes_of_all_kinds_are_shown(tmp_path, name):
    recorded, moments, scene = show(Simulation.from_file(name), tmp_path, seconds=0.03, each=5)
    for part in scene.part_names:
        assert len(recorded.rows[f"/world/parts/{part}"]) == len(moments)


@pytest.mark.parametrize("name", ["universal_pendulum", "planar_puck", "tumbling"])
def test_drawn_efforts_have_the_power_of_the_equations(name):
    """Force times velocity and couple times angular velocity, for each coordinate separately."""
    sim = Simulation.from_file(name)
    (joint,) = sim.mechanism.joints.values()
    sim.step(50)
    after = Simulation(sim.mechanism, step=1e-8)
    after.reset(sim.q, sim.u)
    after.step()
    before, later = (each.poses()[joint.child] @ joint.child_pose for each in (sim, after))
    velocity = (later.position - before.position) / 1e-8
    spin = (later.rotation - before.rotation) / 1e-8 @ before.rotation.T
    omega = np.array([spin[2, 1], spin[0, 2], spin[1, 0]])
    writer = RowMaker(sim.model)
    scene = describe_scene(sim.model, writer.layout, DisplayOptions())
    (drawn,) = loads(scene)
    for index, speed in enumerate(sim.u):
        sim.set_efforts(np.eye(len(sim.u))[index])
        row = writer.row(sim.time, sim.time, sim.state, sim.inputs, sim.energies)
        rows = Rows(writer.layout, row[None])
        acting = zip(drawn.scales, drawn.vectors(rows, PartPoses(scene, rows)), strict=True)
        power = sum(vectors[0] @ (omega if scale.couple else velocity) for scale, (_, vectors) in acting)
        assert power == pytest.approx(speed, rel=1e-3, abs=1e-4)


def test_contacts_are_points_and_arrows_while_they_are_closed(tmp_path):
    sim = Simulation.from_file("rocking")
    states = []
    recorded, _, scene = show(sim, tmp_path, seconds=0.8, each=20, read=lambda: states.append(sim.contacts()))
    scale = LONG * scene.extent.size / weight(scene)
    points, arrows = (
        [row for _, row in recorded.rows[f"/world/contact_forces/{name}"]] for name in ("points", "force")
    )
    kept = {"left": 0, "right": 0}
    for point, arrow, contacts in zip(points, arrows, states, strict=True):
        closed = {name: state for name, state in contacts.items() if state.state != "open"}
        for name in closed:
            kept[name] += 1
        np.testing.assert_allclose(
            np.reshape(point["Points3D:positions"] or [], (-1, 3)),
            np.reshape([state.point for state in closed.values()], (-1, 3)),
            atol=1e-6,
        )
        np.testing.assert_allclose(
            np.reshape(arrow["Arrows3D:vectors"] or [], (-1, 3)),
            np.reshape([scale * state.force for state in closed.values()], (-1, 3)),
            atol=1e-6,
        )
        np.testing.assert_allclose(
            np.reshape(arrow["Arrows3D:origins"] or [], (-1, 3)),
            np.reshape([state.point - scale * state.force for state in closed.values()], (-1, 3)),
            atol=1e-6,
        )
    assert min(kept.values()) > 5


def test_compliant_contacts_are_points_and_arrows_while_they_touch(tmp_path):
    sim, places = Simulation.from_text(SOFT_BALL), []
    read = lambda: places.append(sim.model.contact_readings.places(sim.time, sim.y, sim.inputs)[0])  # noqa: E731
    recorded, _, scene = show(sim, tmp_path, seconds=0.3, each=20, read=read)
    force_scale = ForceScale(weight(scene))
    points, arrows = (
        [row for _, row in recorded.rows[f"/world/contact_forces/{name}"]] for name in ("points", "force")
    )
    touching = [force.any() for _, force, _ in places]
    assert True in touching and False in touching
    for drawn, arrow, (point, force, _) in zip(points, arrows, places, strict=True):
        force_scale.add(force[None])
        scale = LONG * scene.extent.size / force_scale.full
        expected = np.reshape([point] if force.any() else [], (-1, 3))
        expected = scene.extent.in_front(expected, np.ones(len(expected), dtype=bool))
        np.testing.assert_allclose(np.reshape(drawn["Points3D:positions"] or [], (-1, 3)), expected, atol=1e-6)
        if force.any() and scale * np.linalg.norm(force) < 0.6 * scene.extent.size:
            np.testing.assert_allclose(arrow["Arrows3D:vectors"], [scale * force], atol=1e-6)


def test_the_grid_lies_in_the_plane_on_which_the_feet_stand_and_points_away_from_a_surface_are_not_drawn():
    def scene_of(name):
        model = Simulation.from_file(name).model
        return describe_scene(model, RowMaker(model).layout, DisplayOptions())

    from mbd_sim.pictures.rerun.constraints import constraint_entities, floor_of

    point, normal = floor_of(scene_of("column_of_beads"))
    assert (point.tolist(), normal.tolist()) == ([0.0, 0.0, 0.0], [0.0, 0.0, 1.0])
    ratchet = scene_of("ratchet_and_pawl")
    assert not list(constraint_entities(ratchet))
    assert len(ratchet.wires) == 2  # the outlines of the teeth
    for drawn in ratchet.wires:
        (line,) = drawn.form.strips
        assert np.max(np.abs(np.hypot(line[:, 0], line[:, 2]) - 0.05)) == pytest.approx(4e-3 * np.arcsin(0.9), rel=1e-2)


def test_a_slack_rope_is_faint(tmp_path):
    sim = Simulation.from_file("rope")
    recorded, moments, _ = show(sim, tmp_path, seconds=0.6)
    colors = recorded.column("/world/constraints/rope", "LineStrips3D:colors").ravel()
    tight = [time < 0.48133347573 for time, _, _ in moments]
    assert len(set(colors.tolist())) == 2
    assert (colors == colors[0]).tolist() == tight


def test_a_wheel_leaves_a_track_only_where_it_touches(tmp_path):
    sim = Simulation.from_file("spinning_ball")
    recorded, _, _ = show(sim, tmp_path, seconds=0.3)
    assert all(not row["LineStrips3D:strips"] for _, row in recorded.rows["/world/traces/floor"])


def test_an_actuator_between_two_points_is_a_cylinder_in_their_middle(tmp_path):
    sim = Simulation.from_text(TIED + "\nactuators: {push: {type: effort, between: [ground, bob]}}\n")
    recorded, moments, _ = show(sim, tmp_path)
    middles = recorded.column("/world/actuators/push/cylinder", "Transform3D:translation")[:, 0]
    for (_, poses, _), middle in zip(moments, middles, strict=True):
        np.testing.assert_allclose(middle, poses["bob"].position / 2.0, atol=1e-5)


def test_motors_and_bushings_are_cylinders_on_the_parts_that_carry_them(tmp_path):
    text = (
        TIED
        + """  rubber: {type: bushing, between: [bob, ground], stiffness: 1}
actuators: {motor: {type: effort, joint: slide}}
"""
    )
    recorded, _, _ = show(Simulation.from_text(text), tmp_path)
    for entity in ("/world/parts/bob/bushings/rubber", "/world/ground/actuators/motor"):
        assert static_color(recorded, entity) is not None
