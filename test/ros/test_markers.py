"""The topic `markers`: poses, springs and traces in ground's frame."""

import numpy as np
import pytest
from rclpy.serialization import deserialize_message
from visualization_msgs.msg import Marker, MarkerArray

from mbd_sim import Simulation
from mbd_sim.geometry.rotation import from_quaternion
from mbd_sim.mechanism_file.library import shipped
from mbd_sim.messages.snapshot import Due, Snapshot
from mbd_sim.ros.markers import Markers


def snapshot(simulation: Simulation) -> Snapshot:
    ticks = simulation.steps
    return Snapshot(
        ticks, ticks * 1_000_000, simulation.time, simulation.state, simulation.inputs.copy(), 0.0, Due.ALL, False
    )


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
    for name in ("scissor_lift", "spherical_pendulum", "rolling_disc", "stewart", "tube_particles", "atwood"):
        assert name in shipped()
        simulation = Simulation.from_file(name)
        for marker in drawn(Markers(simulation.model), simulation):
            pose = marker.pose
            values = [pose.position.x, pose.position.y, pose.position.z, pose.orientation.w, marker.scale.x]
            values += [value for point in marker.points for value in (point.x, point.y, point.z)]
            assert np.all(np.isfinite(values)) and np.max(np.abs(values)) < 1e3
            assert marker.scale.x > 0.0
