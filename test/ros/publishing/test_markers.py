"""The topic `markers`: poses, springs and traces in ground's frame."""

import numpy as np
import pytest
from rclpy.serialization import deserialize_message
from visualization_msgs.msg import Marker, MarkerArray

from mbd_sim import Simulation, load_mechanism
from mbd_sim.base.geometry.rotation import from_quaternion
from mbd_sim.files.text.library import shipped
from mbd_sim.pictures.shapes.extent import extent_of
from mbd_sim.recordings.messages.states import Due, Snapshot
from mbd_sim.ros.publishing.markers import Markers
from test.generators import mesh_files
from test.simulation.contact.test_contact_forces import SOFT_BALL


def snapshot(simulation: Simulation) -> Snapshot:
    ticks = simulation.steps
    return Snapshot(ticks, ticks * 1_000_000, simulation.time, simulation.snapshot(), Due.ALL)


def drawn(markers: Markers, simulation: Simulation) -> list[Marker]:
    return list(deserialize_message(markers.payload(snapshot(simulation)), MarkerArray).markers)


def test_every_marker_is_in_grounds_frame_and_shapes_move_with_their_parts():
    simulation = Simulation.from_file("double_rod")
    markers = Markers(simulation.model, "left/")
    simulation.run(0.7)
    found = drawn(markers, simulation)
    assert {marker.header.frame_id for marker in found} == {"left/ground"}
    assert {(m.header.stamp.sec, m.header.stamp.nanosec) for m in found} == {(0, 700_000_000)}
    assert len({(marker.ns, marker.id) for marker in found}) == len(found)
    shapes = [(name, shape) for name, part in simulation.mechanism.parts.items() for shape in part.shapes]
    rods = [marker for marker in found if marker.ns == "parts" and marker.type == Marker.CYLINDER]
    assert len(rods) == len(shapes) == 2
    for marker, (name, shape) in zip(rods, shapes, strict=True):
        pose = simulation.poses()[name] @ shape.pose
        at, turn = marker.pose.position, marker.pose.orientation
        assert [at.x, at.y, at.z] == pytest.approx(pose.position.tolist(), abs=1e-12)
        assert from_quaternion(np.array([turn.w, turn.x, turn.y, turn.z])) == pytest.approx(pose.rotation, abs=1e-12)
        assert marker.scale.z == shape.size[0]


def test_springs_are_coils_between_their_ends_and_traces_follow():
    simulation = Simulation.from_file("cart_massive_spring")
    markers = Markers(simulation.model)
    before = drawn(markers, simulation)
    simulation.run(0.5)
    after = drawn(markers, simulation)
    (spring,) = simulation.mechanism.springs
    for found, poses in ((after, simulation.poses()),):
        (coil,) = [marker for marker in found if marker.ns == "springs"]
        ends = [
            at.point if at.part == "ground" else poses[at.part].position + poses[at.part].rotation @ at.point
            for at in (spring.first, spring.second)
        ]
        for end, point in zip(ends, (coil.points[0], coil.points[-1]), strict=True):
            assert [point.x, point.y, point.z] == pytest.approx(end.tolist(), abs=1e-12)
    for old, new in zip(before, after, strict=True):
        if old.ns == "traces":
            assert len({(p.x, p.y, p.z) for p in old.points}) == 1
            assert new.points[-1] != old.points[-1] == new.points[-2]


def test_markers_of_all_kinds_of_mechanisms_are_finite():
    for name in ("scissor_lift", "spherical_pendulum", "rolling_disc", "atwood"):
        assert name in shipped()
        simulation = Simulation.from_file(name)
        for marker in drawn(Markers(simulation.model), simulation):
            pose = marker.pose
            values = [pose.position.x, pose.position.y, pose.position.z, pose.orientation.w, marker.scale.x]
            values += [value for point in marker.points for value in (point.x, point.y, point.z)]
            assert np.all(np.isfinite(values)) and np.max(np.abs(values)) < 1e3
            assert marker.scale.x > 0.0


def test_meshes_are_placed_scaled_and_named_by_a_uri_that_rviz_resolves(tmp_path):
    (tmp_path / "pack").mkdir()
    (tmp_path / "pack" / "a b.dae").write_text(mesh_files.collada())
    (tmp_path / "pack" / "a.STL").write_bytes(mesh_files.binary_stl())
    visual = (
        '<visual><origin xyz="0 0 2"/><geometry><mesh filename="package://pack/{}" scale="2 3 4"/></geometry></visual>'
    )
    (tmp_path / "r.urdf").write_text(
        '<robot name="r"><link name="a"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/></inertial>'
        + "".join(visual.format(name) for name in ("a b.dae", "a.STL", "missing.stl"))
        + '<collision><geometry><box size="1 1 1"/></geometry></collision></link></robot>'
    )
    simulation = Simulation(load_mechanism(tmp_path / "r.urdf", base="free"))
    markers = Markers(simulation.model)
    simulation.run(0.1)
    painted, plain = [marker for marker in drawn(markers, simulation) if marker.ns == "parts"]
    assert painted.type == plain.type == Marker.MESH_RESOURCE
    assert painted.mesh_resource == (tmp_path / "pack" / "a b.dae").as_uri()
    assert plain.mesh_resource.endswith("/pack/a.STL")
    assert [painted.mesh_use_embedded_materials, plain.mesh_use_embedded_materials] == [True, False]
    assert [painted.color.r, painted.color.g, painted.color.b, painted.color.a] == [0.0] * 4  # no tint
    assert plain.color.a == 1.0 and plain.color.r + plain.color.g + plain.color.b > 0.0
    for marker in (painted, plain):
        assert (marker.scale.x, marker.scale.y, marker.scale.z) == (2.0, 3.0, 4.0)
        assert marker.pose.position.z == pytest.approx(2.0 + simulation.poses()["a"].position[2], abs=1e-12)
    assert simulation.poses()["a"].position[2] < -0.04


def test_contacts_are_balls_and_arrows_along_their_forces_that_shrink_while_open():
    simulation = Simulation.from_file("rocking")
    markers = Markers(simulation.model)
    seen = set()
    for _ in range(12):
        simulation.run(simulation.time + 0.1)
        found = drawn(markers, simulation)
        balls, lines, arrows = (
            [m for m in found if m.ns == name] for name in ("contacts", "contact_normals", "contact_forces")
        )
        assert (len(balls), len(lines), len(arrows)) == (2, 2, 2)
        assert [line.scale.z > 1e-3 for line in lines] == [ball.scale.x > 1e-3 for ball in balls]
        for ball, arrow, (name, state) in zip(balls, arrows, simulation.contacts().items(), strict=True):
            closed = state.state != "open"
            seen.add((name, closed))
            assert (ball.scale.x > 1e-3, arrow.scale.x > 1e-3) == (closed, closed)
            assert min(ball.scale.x, arrow.scale.x, arrow.scale.y, arrow.scale.z) > 0.0
            at, turn = ball.pose.position, arrow.pose.orientation
            assert [at.x, at.y, at.z] == state.point.tolist()
            if closed:
                along = from_quaternion(np.array([turn.w, turn.x, turn.y, turn.z]))[:, 0]
                assert along == pytest.approx(state.force / np.linalg.norm(state.force), abs=1e-12)
                tip = np.array([arrow.pose.position.x, arrow.pose.position.y, arrow.pose.position.z])
                tip += arrow.scale.x * along
                assert tip == pytest.approx(state.point, abs=1e-12)
                assert arrow.scale.x == pytest.approx(0.25 * 0.8 * np.linalg.norm(state.force) / 9.81, rel=0.3)
    assert seen == {("left", True), ("left", False), ("right", True), ("right", False)}


def test_compliant_contacts_have_balls_and_arrows_while_they_touch():
    simulation = Simulation.from_text(SOFT_BALL)
    markers, seen = Markers(simulation.model), set()
    for _ in range(20):
        simulation.step(10)
        (ball,), (arrow,) = (
            [m for m in drawn(markers, simulation) if m.ns == name] for name in ("contacts", "contact_forces")
        )
        ((point, force, _),) = simulation.model.contact_readings.places(
            simulation.time, simulation.y, simulation.inputs
        )
        touches = bool(force.any())
        seen.add(touches)
        assert ((ball.scale.x > 1e-3), (arrow.scale.x > 1e-3)) == (touches, touches)
        (shown,) = extent_of(simulation.model).in_front(point[None], np.array([True]))
        assert [ball.pose.position.x, ball.pose.position.y, ball.pose.position.z] == shown.tolist()
    assert seen == {True, False}


def test_an_actuator_between_two_points_is_a_cylinder_between_them():
    text = load_mechanism("rod_pendulum").source.text + "ground: {points: {wall: [1, 0, 0]}}\n"
    text += "actuators: {push: {type: effort, between: [ground.wall, rod]}}\n"
    simulation = Simulation.from_text(text)
    (cylinder,) = [m for m in drawn(Markers(simulation.model, ""), simulation) if m.ns == "actuators"]
    ends = [[point.x, point.y, point.z] for point in (cylinder.points[0], cylinder.points[-1])]
    assert ends == [pytest.approx([1.0, 0.0, 0.0]), pytest.approx([0.0, 0.0, 0.0])]


def test_motors_bushings_and_cylinders_that_follow_a_law_have_markers():
    text = load_mechanism("rod_pendulum").source.text
    text += """ground: {points: {wall: [1, 0, 0]}}
forces:
  gas: {type: line_force, between: [ground.wall, rod], force: x.velocity}
  rubber: {type: bushing, between: [ground.wall, rod], stiffness: 1}
actuators: {motor: {type: effort, joint: pin}}
"""
    simulation = Simulation.from_text(text)
    found = {marker.ns: marker for marker in drawn(Markers(simulation.model, ""), simulation)}
    assert [found[name].type for name in ("dampers", "bushings", "actuators")] == [
        Marker.LINE_LIST, Marker.CYLINDER, Marker.CYLINDER,
    ]  # fmt: skip
    place = found["bushings"].pose.position
    assert [place.x, place.y, place.z] == [1.0, 0.0, 0.0]
    away = found["actuators"].pose.position
    assert [away.x, away.z] == pytest.approx([0.0, 0.0], abs=1e-12) and away.y != 0.0  # on the axis of the pin
