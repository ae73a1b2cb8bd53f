"""Links between files of the repository, as links between pages of the site."""

from __future__ import annotations

import os
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
GENERATED = DOCS / "generated"

_CODE = re.compile(r"(^(?:```|~~~).*?^(?:```|~~~)$|`[^`\n]*`)", re.MULTILINE | re.DOTALL)
_LINK = re.compile(r"(\]\()(?!https?:|mailto:|#)([^)\s#]+)(#[^)\s]*)?(\))")


def relocated(text: str, source: Path, page: Path) -> str:
    """The Markdown `text` of the file `source`, shown on the site as the file `page`, with its links adapted."""

    def link(match: re.Match[str]) -> str:
        opening, target, anchor, closing = match.groups()
        path = _page_of((source.parent / target).resolve())
        return f"{opening}{os.path.relpath(path, page.parent)}{anchor or ''}{closing}"

    pieces = _CODE.split(text)  # text and code by turns; links around code are matched piece by piece
    return "".join(piece if number % 2 else _LINK.sub(link, piece) for number, piece in enumerate(pieces))


def _page_of(path: Path) -> Path:
    """The page of the site that shows a file of the repository; the file itself if none does."""
    name = path.relative_to(ROOT).parts
    match name:
        case ("README.md",):
            return DOCS / "index.md"
        case ("CONTRIBUTING.md",):
            return GENERATED / "contributing.md"
        case ("CHANGELOG.rst",):
            return GENERATED / "changelog.rst"
        case ("test", "README.md"):
            return GENERATED / "tests.md"
        case ("docs", "gallery.md"):
            return GENERATED / "gallery" / "index.md"
        case ("mbd_sim", "examples", folder, "README.md"):
            return GENERATED / "examples" / f"{folder}.md"
        case ("config", _, file) if file.endswith(".yaml"):
            return GENERATED / "gallery" / f"{file.removesuffix('.yaml')}.md"
    return path
