"""The gallery: an index of pictures, and a page for each shipped mechanism with its file."""

from __future__ import annotations

from itertools import groupby

from gallery_pictures import WATCH, Entry, description, entries

from mbd_sim.files.text.library import shipped
from site_pages.links import DOCS

HEADER = """# Gallery

The shipped mechanisms. `mbd_sim run NAME --rerun spawn` shows one in motion, `mbd_sim check NAME` prints its analysis, and `NAME` is accepted wherever
a file is.
"""


def pages() -> dict[str, str]:
    """The pages by their names in `docs/generated/`."""
    listed = entries()
    files = shipped()
    return {
        "gallery/index.md": index(listed),
        **{f"gallery/{entry.name}.md": page(entry, files[entry.name].read_text(encoding="utf-8")) for entry in listed},
    }


def animation(entry: Entry) -> list[str]:
    """The animation of a mechanism, if there is one, with its pace."""
    path = DOCS / "gallery" / f"{entry.name}.webp"
    if not path.exists():
        return []
    return [
        f":::{{figure}} ../../gallery/{path.name}",
        f":alt: {entry.name} in motion",
        ":class: animation\n",
        f"{description(path)[0].upper()}{description(path)[1:]}",
        ":::\n",
    ]


def index(listed: list[Entry]) -> str:
    """The page with the pictures of all mechanisms."""
    lines = [HEADER]
    for folder, group in groupby(listed, key=lambda entry: entry.folder):
        lines += [f"## {folder.replace('_', ' ').capitalize()}\n", "::::{grid} 2 3 3 4", ":gutter: 2\n"]
        for entry in group:
            lines += [
                f":::{{grid-item-card}} {entry.name}",
                f":link: {entry.name}",
                ":link-type: doc",
                f":img-bottom: ../../gallery/{entry.name}.svg",
                f":img-alt: {entry.description}",
                ":class-card: gallery-card",
                ":::",
            ]
        lines.append("::::\n")
    names = "\n".join(entry.name for entry in listed)
    return "\n".join([*lines, f"```{{toctree}}\n:hidden:\n\n{names}\n```\n"])


def page(entry: Entry, file: str) -> str:
    """The page of one mechanism, with its file."""
    return "\n".join(
        [
            f"# {entry.name}\n",
            f"{entry.description} {entry.about}\n",
            f"**{WATCH}** {entry.watch}\n",
            *animation(entry),
            f"![{entry.description}](../../gallery/{entry.name}.svg)\n",
            f"```sh\nmbd_sim check {entry.name}\nmbd_sim run {entry.name} --rerun spawn\n```\n",
            f"`config/{entry.folder}/{entry.file}`:\n",
            f"```yaml\n{file.rstrip()}\n```\n",
        ]
    )
