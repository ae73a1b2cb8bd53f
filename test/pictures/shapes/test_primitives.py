"""Rerun and RViz draw the list of primitives: each at its place, in its color, and nothing else that is fixed."""

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.base.geometry.pose import identity_pose
from mbd_sim.pictures.shapes.extent import extent_of
from mbd_sim.pictures.shapes.primitives import Lines, connectors, primitives, wires
from mbd_sim.ros.publishing.markers import fixed_markers

NAMES = (
    "scissor_lift",
    "driveline",
    "bead_on_wire",
    "spherical_top",
    "slider_crank",
    "screw_press",
    "hydraulic_scissor_lift",
)


def listed(name):
    model = Simulation.from_file(name).model
    extent = extent_of(model)
    return model, extent, [*primitives(model.mechanism, extent, lambda mesh: True), *wires(model, extent)]


def places(shown):
    """The points (n, 3) in the frame of the part by which an archetype of Rerun is placed."""
    keys = ("centers", "translations", "strips", "vertex_positions")
    (values,) = [found for key in keys if (found := getattr(shown, key, None)) is not None]
    return np.concatenate([np.reshape(one, (-1, 3)) for one in values.as_arrow_array().to_pylist()])


@pytest.mark.parametrize("name", NAMES)
def test_both_viewers_place_and_color_a_primitive_alike(name):
    from mbd_sim.pictures.rerun.stream import archetype

    _, extent, drawn = listed(name)
    assert len(drawn) >= 2
    for one in drawn:
        markers, shown = fixed_markers(one, "", extent.size), archetype(one)
        assert {marker.color for marker in markers} == {one.color}
        assert {marker.part for marker in markers} == {one.part}
        points = places(shown)
        if isinstance(one.form, Lines):
            placed = [marker.pose.position + np.array(marker.points) @ marker.pose.rotation.T for marker in markers]
            np.testing.assert_allclose(np.concatenate(placed), points, atol=1e-6)
        else:
            middle = np.mean([marker.pose.position for marker in markers], axis=0)
            np.testing.assert_allclose(middle, one.pose.position, atol=1e-12)
            reach = np.linalg.norm(points - one.pose.position, axis=1).max()
            assert reach < extent.size


@pytest.mark.parametrize("name", NAMES)
def test_the_names_of_what_is_drawn_are_unique(name):
    """Viewers make entities of them."""
    model, extent, drawn = listed(name)
    names = [(one.part, one.kind, *one.path) for one in drawn]
    start = {"ground": identity_pose(), **model.poses(0.0, model.start)}
    names += [(one.kind, one.name) for one in connectors(model.mechanism, extent, start)]
    assert len(set(names)) == len(names)


def test_coils_and_cylinders_are_slender_where_they_are_short():
    model, extent, _ = listed("cart_massive_spring")
    (spring,) = connectors(model.mechanism, extent, {"ground": identity_pose(), **model.poses(0.0, model.start)})
    assert (spring.kind, spring.form) == ("springs", "coil")
    assert 0.0 < spring.radius <= 0.032 * extent.size
