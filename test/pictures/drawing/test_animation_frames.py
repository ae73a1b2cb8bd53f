"""Frames of a sampled motion: how many there are, and traced paths through the samples between them."""

import numpy as np

from mbd_sim import Simulation
from mbd_sim.pictures.drawing.animation import Animation
from mbd_sim.pictures.drawing.picture import mechanism_sheet
from mbd_sim.pictures.drawing.sheet import STEEL, ScaledView, view_of


def test_paths_go_through_samples_between_frames():
    sim, samples = Simulation.from_file("double_rod"), []
    for _ in range(41):
        samples.append((sim.time, sim.poses()))
        sim.step(10)
    tips = np.array([poses["lower"].position + poses["lower"].rotation @ [0.0, 0.0, -1.0] for _, poses in samples])
    animation = Animation(sim.model, 120, 80, [poses for _, poses in samples], ["lower.tip"])
    frames = list(animation.frames(samples, rate=12.5))
    assert len(frames) == 6  # from 0 to 0.4 s
    assert np.allclose(animation._paths[0], tips)


def test_with_fewer_samples_than_frames_each_is_one():
    sim = Simulation.from_file("double_rod")
    samples = [(0.1 * number, sim.poses()) for number in range(4)]
    assert len(list(Animation(sim.model, 120, 80).frames(samples, rate=25.0))) == 4


def test_supports_of_ground_stay_where_they_are():
    sim = Simulation.from_file("rod_pendulum")
    mechanism, start = sim.mechanism, sim.poses()
    sim.reset(q=[np.pi])  # upright
    page = ScaledView(view_of(mechanism, start), 100.0)

    def supports(poses, start=None):
        sheet = mechanism_sheet(page, mechanism, poses, 1.0, [], start)
        return [path.points.round(9).tolist() for path in sheet.paths if path.fill == STEEL]

    assert supports(sim.poses(), start) == supports(start) != supports(sim.poses())
