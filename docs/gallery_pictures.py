"""The gallery of shipped mechanisms: `python docs/gallery_pictures.py docs` writes its page and pictures.

Names after the folder limit the pictures to these mechanisms. They are drawn at their start, and as small animations.

Its texts are in the mechanism files. The comment at the top of a file says what the mechanism is and which book it is
from; a paragraph in it that begins with `Watch:` says what to look at; `description` summarizes it.
"""

from __future__ import annotations

import io
import itertools
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from mbd_sim.base.errors import MbdSimError, nearest, quoted
from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.files.load import load_mechanism
from mbd_sim.files.text.library import shipped
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.pictures.drawing.animation import Animation, Frame
from mbd_sim.pictures.drawing.parts import bounding_points
from mbd_sim.pictures.drawing.picture import draw
from mbd_sim.simulation.run.simulation import BaseSimulation

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
    simulation = BaseSimulation(load_mechanism(name))
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


def _followed(simulation: BaseSimulation) -> tuple[float, list[Configuration]]:
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


def _poses(simulation: BaseSimulation, interval: float) -> list[Configuration]:
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


FIRST = ("open_chains", "prescribed", "constraints", "forces")  # folders of config/; others follow in alphabetic order
WATCH = "Watch:"
HEADER = """# Gallery

The shipped mechanisms in their start positions. `make gallery` writes this page and its pictures from the files.
`mbd_sim run NAME --rerun spawn` shows a mechanism in motion, `mbd_sim check NAME` prints its analysis.

The `limits` of a joint alone do not stop its motion: they are passed on to viewers and controllers, and a cart goes on
beyond the end of its rail. With `stiffness` or `restitution` they are [stops](mechanism_file.md#stops-and-friction).
"""


@dataclass(frozen=True)
class Entry:
    """A mechanism of the gallery: its texts, and the folder of `config/` that contains its file."""

    name: str
    folder: str
    file: str
    description: str
    about: str
    watch: str


def entries() -> list[Entry]:
    """Every shipped mechanism, grouped by folder.

    :raises MbdSimError: a file does not say what to watch; the message names all such files.
    """
    found = [_entry(name, path) for name, path in shipped().items()]
    silent = [f"config/{entry.folder}/{entry.file}" for entry in found if not (entry.watch and entry.about)]
    if silent:
        raise MbdSimError(
            f"The comment at the top does not say what the mechanism is and what to watch in {', '.join(silent)}. "
            f"Begin the file with a line such as '# A rod on a pin (Huston & Liu 8.9).' and one that begins with "
            f"'# {WATCH}', then run `make gallery`."
        )
    order = {folder: rank for rank, folder in enumerate(FIRST)}
    return sorted(found, key=lambda entry: (order.get(entry.folder, len(order)), entry.folder, entry.name))


def page(listed: list[Entry]) -> str:
    """The text of `gallery.md`."""
    lines = [HEADER]
    for folder, group in groupby(listed, key=lambda entry: entry.folder):
        lines.append(f"## {folder.replace('_', ' ').capitalize()}\n")
        for entry in group:
            lines += [
                f"### {entry.name}\n",
                f"![{entry.description}](gallery/{entry.name}.svg)\n",
                f"{entry.description} {entry.about}\n",
                f"**{WATCH}** {entry.watch}\n",
                f"File: [config/{entry.folder}/{entry.file}](../config/{entry.folder}/{entry.file})\n",
            ]
    return "\n".join(lines)


def picture(entry: Entry, folder: Path) -> Path:
    """Draw a mechanism at its start into `folder`/name.svg.

    :raises DrawingError: the file cannot be written.
    """
    simulation = BaseSimulation(load_mechanism(entry.name))
    path = folder / f"{entry.name}.svg"
    draw(simulation.mechanism, simulation.poses(), path)
    return path


def main(docs: Path, names: Sequence[str] = ()) -> None:
    """Write the page, and the pictures of the named mechanisms or of all; remove those of mechanisms no longer shipped.

    :raises MbdSimError: no mechanism of a name is shipped.
    """
    listed, folder = entries(), docs / "gallery"
    known = {entry.name for entry in listed}
    for name in names:
        if name not in known:
            raise MbdSimError(f"There is no shipped mechanism {quoted(name)}. {nearest(name, known)}".rstrip())
    folder.mkdir(parents=True, exist_ok=True)
    for entry in listed:
        if not names or entry.name in names:
            picture(entry, folder)
            if animate(entry.name, folder) is None:
                (folder / f"{entry.name}.webp").unlink(missing_ok=True)
    for path in folder.iterdir():
        if path.stem not in known:
            path.unlink()
    (docs / "gallery.md").write_text(page(listed), encoding="utf-8")


def _entry(name: str, path: Path) -> Entry:
    about, watch = comment(path.read_text(encoding="utf-8"))
    description = " ".join(load_mechanism(path).description.split())
    return Entry(name, path.parent.name, path.name, description, about, watch)


def comment(text: str) -> tuple[str, str]:
    """The first comment of a file in two parts: what the mechanism is, and what to watch; "" where a part is absent."""
    lines: list[str] = []
    for line in text.splitlines():
        if not line.startswith("#"):
            break
        if "yaml-language-server" not in line:
            lines.append(line.removeprefix("#").strip())
    about, _, watch = " ".join(lines).partition(WATCH)
    return about.strip(), watch.strip()


if __name__ == "__main__":
    try:
        main(Path(sys.argv[1] if len(sys.argv) > 1 else "docs"), sys.argv[2:])
    except MbdSimError as error:
        sys.exit(str(error))
