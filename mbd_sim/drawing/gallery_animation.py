"""Small animations of the shipped mechanisms for the gallery."""

from __future__ import annotations

import io
import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from mbd_sim.drawing.animation import Animation
from mbd_sim.drawing.animation_file import Frame
from mbd_sim.drawing.part_outlines import bounding_points
from mbd_sim.errors import MbdSimError
from mbd_sim.geometry.pose import Array, Pose
from mbd_sim.load import load_mechanism
from mbd_sim.mechanism.records import Mechanism
from mbd_sim.simulation.simulation import Simulation

SIZE = (320, 240)  # px, the largest picture; blank margins are cut off
FRAMES, PERIOD = 36, 80  # the most frames, and the time in ms for which each is shown
COLORS, NEAR_WHITE = 12, 244
FEWEST = 4  # changes of the picture, without which there is no animation
LARGEST = 150_000  # bytes of a file; if all frames take more, every other frame is left out
PACES = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0)  # seconds of motion for each second of the animation
STRIDE = 0.15  # of the size of the picture: the most by which a point should move from frame to frame
MARGIN = 6  # px
SYMBOLS = 1.4  # size of the picture relative to that of the parts, which symbols of ground and joints exceed
DESCRIPTION = 0x010E  # tag of Exif

Configuration = Mapping[str, Pose]


def animate(name: str, folder: Path) -> Path | None:
    """Draw the shipped mechanism `name` in motion into `folder`/name.webp; None if nothing in the picture moves.

    The animation shows the motion from the start at the largest of `PACES` at which it can be followed, which the file
    contains as its description. Where the motion repeats itself within the animation, so does the animation.

    :raises MbdSimError: the file is larger than `LARGEST`.
    """
    simulation = Simulation(load_mechanism(name))
    pace, poses = _followed(simulation)
    animation = Animation(simulation.model, *SIZE, configurations=poses, margin=SYMBOLS)
    frames = cropped([animation.frame(configuration) for configuration in poses])
    if sum(not np.array_equal(one, other) for one, other in itertools.pairwise(frames)) < FEWEST:
        return None
    content = encoded(frames, _description(pace))
    if len(content) > LARGEST:
        content = encoded(frames[::2], _description(pace), 2 * PERIOD)
    if len(content) > LARGEST:
        raise MbdSimError(
            f"The animation of {name} has {len(content)} bytes, more than {LARGEST}: lower FRAMES or SIZE."
        )
    path = folder / f"{name}.webp"
    path.write_bytes(content)
    return path


def _description(pace: float) -> str:
    if pace == 1.0:
        return "in real time"
    return f"{pace:g} times as fast as real time" if pace > 1.0 else f"{1.0 / pace:g} times slower than real time"


def description(path: Path) -> str:
    """How fast an animation of the gallery shows the motion."""
    with Image.open(path) as picture:
        return str(picture.getexif()[DESCRIPTION])


def _followed(simulation: Simulation) -> tuple[float, list[Configuration]]:
    """The pace, and the poses of the parts in each frame."""
    for pace in PACES:  # from slow to fast, because turns from frame to frame cannot be seen
        poses = _poses(simulation, 1e-3 * PERIOD * pace)
        points = _points(simulation.mechanism, poses)
        if pace > PACES[0] and np.quantile(_strides(points), 0.9) > STRIDE:
            break
        chosen = pace, poses[: repetition(points)]
    return chosen


def _points(mechanism: Mechanism, poses: Sequence[Configuration]) -> Array:
    """Points (frames, points, 3) in m by whose motion the pace is chosen: centers and named points of the parts.

    Where those are at rest, as of a spinning disc, they are the corners of the parts.
    """
    points = np.array(
        [
            [
                pose[name].position + pose[name].rotation @ at
                for name, part in mechanism.parts.items()
                for at in (part.center, *(point.position for point in part.points.values()))
            ]
            for pose in poses
        ]
    )
    corners = np.array([bounding_points(mechanism, pose) for pose in poses])
    return points if np.ptp(points, axis=0).max() > STRIDE * np.ptp(corners, axis=(0, 1)).max() else corners


def _poses(simulation: Simulation, interval: float) -> list[Configuration]:
    simulation.reset()
    poses = [simulation.poses()]
    while len(poses) < FRAMES:
        simulation.run(until=len(poses) * interval)
        poses.append(simulation.poses())
    return poses


def _strides(points: Array) -> Array:
    """The largest displacement between consecutive frames, relative to the size of the space that all of them take."""
    size = float(np.max(np.ptp(points, axis=(0, 1)))) or 1.0
    return np.asarray(np.linalg.norm(np.diff(points, axis=0), axis=2).max(axis=1) / size)


def repetition(points: Array) -> int:
    """The number of frames after which the motion of points (frames, points, 3) repeats itself, or that of all."""

    def distance(one: int, other: int) -> float:
        return float(np.linalg.norm(points[one] - points[other], axis=1).max())

    stride = distance(0, 1)
    for frame in range(len(points) // 3, len(points) - 1):
        if distance(0, frame) < 0.5 * stride and distance(1, frame + 1) < 0.5 * stride:
            return frame
    return len(points)


def cropped(frames: Sequence[Frame]) -> list[Frame]:
    """Frames without the blank margins that all of them have."""
    drawn = np.any([np.any(frame < 250, axis=2) for frame in frames], axis=0)
    rows, columns = (_range(np.flatnonzero(drawn.any(axis=axis)), drawn.shape[1 - axis]) for axis in (1, 0))
    return [frame[rows, columns] for frame in frames]


def _range(drawn: NDArray[np.intp], size: int) -> slice:
    return slice(max(int(drawn[0]) - MARGIN, 0), min(int(drawn[-1]) + 1 + MARGIN, size))


def encoded(frames: Sequence[Frame], description: str, period: int = PERIOD) -> bytes:
    """An animated WebP without loss, in few colors; each frame is shown for `period` ms."""
    exif = Image.Exif()
    exif[DESCRIPTION] = description

    palette = Image.fromarray(np.vstack(frames[:: max(len(frames) // 4, 1)])).quantize(COLORS, dither=Image.Dither.NONE)
    colors = np.array(palette.getpalette())[: 3 * COLORS].reshape(-1, 3)
    colors[colors.min(axis=1) >= NEAR_WHITE] = 255  # the background, which is averaged with the edges of what is drawn
    palette.putpalette(colors.ravel().tolist())
    images = [
        Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE).convert("RGB") for frame in frames
    ]
    content = io.BytesIO()
    images[0].save(
        content, "WEBP", save_all=True, append_images=images[1:], duration=period, loop=0,
        lossless=True, method=6, minimize_size=True, exif=exif,
    )  # fmt: skip
    return content.getvalue()
