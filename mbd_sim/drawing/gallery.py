"""The gallery of the shipped mechanisms: `python -m mbd_sim.drawing.gallery docs` writes `gallery.md` and its pictures.

Names after the folder limit the pictures to these mechanisms.

Its texts are in the mechanism files. The comment at the top of a file says what the mechanism is and which book it
is from; a paragraph in it that begins with `Watch:` says what to look at; `description` summarizes it.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

from mbd_sim.drawing.gallery_animation import animate
from mbd_sim.drawing.picture import draw
from mbd_sim.errors import MbdSimError, nearest, quoted
from mbd_sim.load import load_mechanism
from mbd_sim.mechanism_file.library import shipped
from mbd_sim.simulation.simulation import Simulation

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
    simulation = Simulation(load_mechanism(entry.name))
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
