"""Writes frames as an animation: GIF, WebP, MP4, or an HTML page that plays them and needs nothing else."""

from __future__ import annotations

import base64
import html
import io
import json
from collections.abc import Iterable, Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mbd_sim.drawing.picture import DrawingError
from mbd_sim.packages import require_packages

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
