"""Animations of a mechanism in motion: GIF, WebP, MP4, or an HTML page that plays them and needs nothing else.

All frames have the same size, position and scale.
"""

from __future__ import annotations

import base64
import html
import io
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbd_sim.base.geometry.pose import Array, Pose
from mbd_sim.base.packages import require_packages
from mbd_sim.mechanism.mechanism import Mechanism
from mbd_sim.pictures.drawing.constraints import constraint_curves
from mbd_sim.pictures.drawing.contacts import contact_paths
from mbd_sim.pictures.drawing.parts import bounding_points, pointer_paths
from mbd_sim.pictures.drawing.picture import POINTS, Composition, DrawingError, mechanism_sheet, pixels
from mbd_sim.pictures.drawing.sheet import FRONT, GRAY, MARKS, ScaledView, Sheet, SheetPath, SheetText, view_of
from mbd_sim.pictures.shapes.joints import LONG, traced_points, weight
from mbd_sim.pictures.shapes.palette import part_colors
from mbd_sim.pictures.shapes.solids import circle
from mbd_sim.pictures.shapes.touching import NONE_TOUCHING, ForceScale, Touching
from mbd_sim.simulation.model.model import Model

TRACE_POINTS = 8  # of a traced path for each frame
SAMPLES = 60  # random configurations from which the window is found
STROKE = 0.5  # m in each direction, of sliding joints without limits
MARGIN = 1.12
BORDER = 3.0  # pt, around everything that is drawn
FITTINGS = 4
TRACE_COLORS = ((208, 58, 50), (124, 77, 190), (20, 136, 110))
TRACE_WIDTH, TRACE_DOT = 1.6, 3.0  # pt, of the line and of the dot at its end
NEARLY = 1e-6  # frames by which a time may be early by round-off
CAPTION_PLACE, CAPTION_SIZE = np.array([60.0, 14.0]), 11.0  # pt


class Animation:
    """Frames of a mechanism, in a window that contains a set of configurations."""

    def __init__(
        self,
        model: Model,
        width: int = 600,
        height: int = 400,
        configurations: Sequence[Mapping[str, Pose]] | None = None,
        traces: Sequence[str] = (),
        margin: float = MARGIN,
    ) -> None:
        """Frames of `width` times `height` pixels.

        :param configurations: poses of the parts that the window shows; by default those that the joints and the loops
            allow.
        :param traces: points, `part.point`, and parts, which stand for their ends, whose paths through all frames so
            far are drawn.
        :param margin: the size of the window relative to that of the parts and points in it; symbols reach beyond them.
        :raises InputError: there is no such part or point.
        """
        self._mechanism, self._size = model.mechanism, np.array([width, height], dtype=float)
        start = self._start = model.poses(0.0, model.start)
        self._view = view_of(self._mechanism, start)
        axes = np.column_stack([self._view.right, self._view.up])
        self._names, self._traced = traces, traced_points(self._mechanism, traces)
        self._paths: list[list[Array]] = [[] for _ in traces]
        shown = _reachable_poses(model) if configurations is None else configurations
        projected = [
            np.vstack([bounding_points(self._mechanism, poses), *self._traced_points(poses)]) @ axes
            for poses in (start, *shown)
        ]
        low, high = np.vstack(projected).min(axis=0), np.vstack(projected).max(axis=0)
        self._mechanism_size = max(
            float(np.max(np.ptp(projected[0], axis=0))), 1e-9
        )  # symbols are drawn in proportion to it
        self._force_scale = ForceScale(weight(self._mechanism, self._mechanism_size))
        scale = float(np.min(self._size / np.maximum((high - low) * margin, 0.2 * self._mechanism_size)))
        self._page = ScaledView(self._view, scale)
        self._shift = 0.5 * self._size - 0.5 * (low + high) * scale
        self._extreme = [(start, *shown)[number] for number in _extreme(projected)]
        self._arrow_ends = np.zeros((0, 3))
        self._fit()

    def _fit(self) -> None:
        """Make the page smaller, or move it, where symbols of the extreme configurations reach beyond the window."""
        room = self._size - 2.0 * BORDER
        for _ in range(FITTINGS):  # symbols have a size of their own, so that the first attempt may not be enough
            low, high = self._bounds()
            excess = float(np.max((high - low) / room))
            if excess <= 1.0:
                break
            self._page = ScaledView(self._view, self._page.scale / excess)
            self._shift = 0.5 * self._size + (self._shift - 0.5 * self._size) / excess
        low, high = self._bounds()
        self._shift = np.clip(self._shift, BORDER - low, np.maximum(self._size - BORDER - high, BORDER - low))

    def _bounds(self) -> tuple[Array, Array]:
        """The corners (2,) of everything that is drawn, before it is moved into the window."""
        bounds = [self._sheet(poses).bounds() for poses in self._extreme]
        if len(arrows := self._page.project(self._arrow_ends)):
            bounds.append((arrows.min(axis=0), arrows.max(axis=0)))
        return np.min([one[0] for one in bounds], axis=0), np.max([one[1] for one in bounds], axis=0)

    def _sheet(self, poses: Mapping[str, Pose]) -> Sheet:
        curves = constraint_curves(self._mechanism, poses, self._view)
        sheet = mechanism_sheet(self._page, self._mechanism, poses, self._mechanism_size, curves, self._start)
        sheet.add(*traced_point_paths(self._page, self._mechanism, self._traced, poses))
        return sheet

    def frame(
        self, poses: Mapping[str, Pose], caption: str = "", contacts: Touching = NONE_TOUCHING
    ) -> NDArray[np.uint8]:
        """The mechanism with its parts at `poses`, in ground's frame in m: (height, width, 3).

        :param contacts: that are closed, as from `mbd_sim.pictures.shapes.touching.touching`.
        """
        self._force_scale.add(contacts.forces)
        sheet = self._sheet(poses)
        sheet.add(*contact_paths(self._page, contacts, self._mechanism_size, self._force_scale.full))
        sheet.add(*self._extended_traces(poses))
        sheet = sheet.translated(self._shift)
        if caption:
            sheet.texts.append(SheetText(caption, CAPTION_PLACE, CAPTION_SIZE, GRAY))
        return pixels(Composition(sheet, self._size), POINTS)

    def follow(self, poses: Mapping[str, Pose]) -> None:
        """Extend the traced paths by poses between two frames."""
        for path, point in zip(self._paths, self._traced_points(poses), strict=True):
            path.append(point)

    def frames(
        self,
        samples: Sequence[tuple[float, Mapping[str, Pose]]],
        rate: float,
        mechanisms: Sequence[Mechanism] = (),
        contacts: Sequence[Touching] = (),
    ) -> Iterator[NDArray[np.uint8]]:
        """The frames of a motion, `rate` of them for each second of it, with the time as caption.

        :param samples: times in s and poses; those between two frames extend the traced paths.
        :param mechanisms: at each of the samples, if its values, such as lengths, change.
        :param contacts: that are closed, at each of the samples.
        """
        begin, drawn = samples[0][0], 0
        self._make_room(contacts)
        for number, (time, poses) in enumerate(samples):
            if mechanisms and mechanisms[number] is not self._mechanism:
                self._mechanism = mechanisms[number]
                self._traced = traced_points(self._mechanism, self._names)
            if (time - begin) * rate >= drawn - NEARLY:
                drawn += 1
                yield self.frame(poses, f"t = {time:.2f} s", contacts[number] if contacts else NONE_TOUCHING)
            else:
                self.follow(poses)

    def _make_room(self, contacts: Sequence[Touching]) -> None:
        """For the arrows at the contacts of a whole motion, in a scale that does not change."""
        for closed in contacts:
            self._force_scale.add(closed.forces)
        size, full = self._mechanism_size, self._force_scale.full
        ends = [end for closed in contacts for arrow in closed.arrows(size, full, longest=LONG) for end in arrow]
        if ends:
            self._arrow_ends = np.array(ends)
            self._fit()

    def _traced_points(self, poses: Mapping[str, Pose]) -> list[Array]:
        return [poses[part].position + poses[part].rotation @ point for part, point in self._traced]

    def _extended_traces(self, poses: Mapping[str, Pose]) -> list[SheetPath]:
        """The paths up to this frame."""
        self.follow(poses)
        drawn = []
        for number, path in enumerate(self._paths):
            color = TRACE_COLORS[number % len(TRACE_COLORS)]
            drawn.append(SheetPath(self._page.project(np.array(path)), edge=color, width=TRACE_WIDTH, layer=FRONT))
            dot = self._page.project(path[-1]) + TRACE_DOT * circle(np.linspace(0.0, 2.0 * np.pi, 13))
            drawn.append(SheetPath(dot, edge=None, fill=color, closed=True, layer=MARKS))
        return drawn


def traced_point_paths(
    page: ScaledView, mechanism: Mechanism, traced: Sequence[tuple[str, Array]], poses: Mapping[str, Pose]
) -> list[SheetPath]:
    """Bars to traced points that lie beside the shapes of their parts, see `traced_points`."""
    colors = part_colors(mechanism)
    return [
        path
        for name, point in traced
        if name in mechanism.parts
        for path in pointer_paths(page, mechanism.parts[name], point, poses[name], colors[name])
    ]


def _extreme(projected: Sequence[Array]) -> list[int]:
    """The numbers of the configurations that reach farthest to each side, and of the first."""
    lows, highs = (np.array([find(one, axis=0) for one in projected]) for find in (np.min, np.max))
    return sorted({0, *lows.argmin(axis=0).tolist(), *highs.argmax(axis=0).tolist()})


def _reachable_poses(model: Model) -> list[Mapping[str, Pose]]:
    """The poses in some of the configurations that the joints and the loops allow."""
    rng, found = np.random.default_rng(0), []
    y = model.start.copy()
    for _ in range(SAMPLES):
        try:
            y[model.q_range] = model.consistent(_random_configuration(model, rng), np.zeros(model.layout.nv))[0]
        except ValueError:  # the loops do not close near it
            continue
        found.append(model.poses(0.0, y))
    return found


def _random_configuration(model: Model, rng: np.random.Generator) -> Array:
    """Coordinates q, not yet consistent with the loops, drawn within the limits of the joints."""
    q = model.start[model.q_range].copy()
    for name, joint in model.mechanism.joints.items():
        indices = model.layout.q[name]
        if joint.type == "prismatic" and not joint.limits:
            q[indices] += rng.uniform(-STROKE, STROKE)
        elif joint.type in ("revolute", "universal") and not joint.limits:
            q[indices] = rng.uniform(-np.pi, np.pi, indices.stop - indices.start)
        for index, limits in zip(range(indices.start, indices.stop), joint.limits, strict=False):
            if limits is not None:
                q[index] = rng.uniform(limits.lower, limits.upper)
    return q


SUFFIXES = (".gif", ".webp", ".mp4", ".html")
FRAME_RATE = 25  # per second: GIF counts in hundredths of a second
GIF_COLORS = 64  # drawings have few colors
_BIT_RATE = 2_000_000  # per second, of MP4

Frame = NDArray[np.uint8]


def require_animation_packages(path: Path) -> None:
    """Refuse an animation whose packages are missing, before anything is computed for it.

    :raises MissingPackageError: Matplotlib or Pillow, or PyAV for MP4, is not installed.
    """
    require_packages("matplotlib", "PIL", purpose="An animation")
    if path.suffix == ".mp4":
        require_packages("av", purpose="An .mp4 file", otherwise="or choose a .gif or .html file.")


def write_animation(path: Path, frames: Iterable[Frame], title: str) -> None:
    """Write frames (height, width, 3) at `FRAME_RATE`; `title` is that of a page.

    :raises MissingPackageError: see `require_animation_packages`.
    :raises DrawingError: the file cannot be written.
    """
    require_animation_packages(path)
    try:
        match path.suffix:
            case ".gif":
                _write_gif(path, frames)
            case ".webp":
                _write_webp(path, frames)
            case ".mp4":
                _write_mp4(path, frames)
            case _:
                path.write_text(_page(frames, title), encoding="utf-8")
    except OSError as error:
        raise DrawingError(f"{path} cannot be written: {error.strerror or error}") from error


def _images(frames: Iterable[Frame]) -> Iterator[Any]:
    """The frames as pictures with few colors, which are small."""
    from PIL import Image

    for frame in frames:
        yield Image.fromarray(frame).quantize(GIF_COLORS, dither=Image.Dither.NONE)


def _write_gif(path: Path, frames: Iterable[Frame]) -> None:
    first, *others = _images(frames)
    first.save(path, save_all=True, append_images=others, duration=1000 // FRAME_RATE, loop=0, disposal=1)


def _write_webp(path: Path, frames: Iterable[Frame]) -> None:
    """Lossless, at two thirds of the size of GIF."""
    first, *others = (image.convert("RGB") for image in _images(frames))
    first.save(path, save_all=True, append_images=others, duration=1000 // FRAME_RATE, loop=0, lossless=True, method=4)


def _write_mp4(path: Path, frames: Iterable[Frame]) -> None:
    import av

    with av.open(str(path), "w") as container:
        stream: Any = None
        for number, frame in enumerate(frames):
            if stream is None:
                stream = container.add_stream("libx264", rate=FRAME_RATE)
                stream.height, stream.width = (size // 2 * 2 for size in frame.shape[:2])  # the format wants even sizes
                stream.pix_fmt, stream.bit_rate, stream.time_base = "yuv420p", _BIT_RATE, Fraction(1, FRAME_RATE)
            even = np.ascontiguousarray(frame[: stream.height, : stream.width])
            picture = av.VideoFrame.from_ndarray(even, format="rgb24")
            picture.pts, picture.time_base = number, Fraction(1, FRAME_RATE)
            container.mux(stream.encode(picture))
        if stream is not None:
            container.mux(stream.encode())


def _page(frames: Iterable[Frame], title: str) -> str:
    pictures, size = [], (0, 0)
    for image in _images(frames):
        content = io.BytesIO()
        image.save(content, "PNG", optimize=True)
        pictures.append(base64.b64encode(content.getvalue()).decode())
        size = image.size
    width, height = size
    return (
        _PAGE.replace("TITLE", html.escape(title))
        .replace("WIDTH", str(width))
        .replace("HEIGHT", str(height))
        .replace("RATE", str(FRAME_RATE))
        .replace("PICTURES", json.dumps(pictures))
    )


_PAGE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>TITLE</title>
<style>
body { font-family: sans-serif; margin: 1em auto; width: WIDTHpx; max-width: 95%; }
img { width: 100%; display: block; }
.controls { display: flex; gap: 0.6em; align-items: center; }
input { flex: 1; }
output { min-width: 5em; text-align: right; }
</style>
</head>
<body>
<img id="picture" width="WIDTH" height="HEIGHT" alt="TITLE">
<div class="controls">
<button id="play" type="button">Pause</button>
<input id="slider" type="range" min="0" value="0" aria-label="time">
<select id="speed" aria-label="speed">
<option value="0.1">0.1 ×</option><option value="0.25">0.25 ×</option><option value="0.5">0.5 ×</option>
<option value="1" selected>1 ×</option><option value="2">2 ×</option><option value="4">4 ×</option>
</select>
<output id="time"></output>
</div>
<script>
const rate = RATE, pictures = PICTURES;
const [picture, play, slider, speed, time] =
  ["picture", "play", "slider", "speed", "time"].map(name => document.getElementById(name));
let position = 0, playing = true, last = null;
slider.max = pictures.length - 1;
function show() {
  const number = Math.min(Math.floor(position), pictures.length - 1);
  picture.src = "data:image/png;base64," + pictures[number];
  slider.value = number;
  time.value = (number / rate).toFixed(2) + " s";
}
function frame(now) {
  if (playing && last !== null) {
    position = (position + (now - last) / 1000 * rate * Number(speed.value)) % pictures.length;
    show();
  }
  last = now;
  requestAnimationFrame(frame);
}
play.onclick = () => { playing = !playing; play.textContent = playing ? "Pause" : "Play"; };
slider.oninput = () => { position = Number(slider.value); show(); };
show();
requestAnimationFrame(frame);
</script>
</body>
</html>
"""
