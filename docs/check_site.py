"""Checks a built site: `check_site.py FOLDER` prints its size, and every problem of its pages; exit code 1 if there is one.

Elements are closed in order. Links within the site lead to pages and anchors that exist, pictures and scripts are there,
every picture has a text, and every page can be reached from others. Nothing is loaded from the network.
"""

from __future__ import annotations

import re
import sys
from dataclasses import dataclass, field
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

LARGEST = 40e6  # bytes
UNLINKED = {"genindex.html", "search.html", "py-modindex.html"}  # only scripts lead to some of Sphinx's own pages
SOURCES = {"a": "href", "img": "src", "script": "src", "link": "href", "source": "src", "video": "src"}
VOID = {"area", "base", "br", "col", "embed", "hr", "img", "input", "link", "meta", "source", "track", "wbr"}
OPTIONAL_END = {"p", "li", "dd", "dt", "option", "td", "th", "tr", "tbody", "thead", "colgroup"}
FAULTS = {
    "system-message": "a message of Sphinx",
    "problematic": "a message of Sphinx",
    "traceback": "an error in a notebook",
}
COMMAND_NOT_FOUND = re.compile(
    r"\bsh: (?:\d+: |line \d+: )?(\S+: (?:command )?not found)"
)  # in the output of a notebook


@dataclass
class Page(HTMLParser):
    """What the check needs of a page."""

    text: str
    anchors: set[str] = field(default_factory=set)
    links: list[tuple[str, str]] = field(default_factory=list)  # (element, address)
    problems: list[str] = field(default_factory=list)
    headings: int = 0
    viewport: bool = False
    _open: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        """Parse the text."""
        super().__init__()
        self.feed(self.text)
        self.close()
        if self.headings > 1:
            self.problems.append(f"{self.headings} headings of the first level")
        if not self.viewport:
            self.problems.append("no viewport for phones")
        self.problems += [f"a command of a notebook: {text}" for text in COMMAND_NOT_FOUND.findall(self.text)]
        self.problems += [f"<{tag}> is not closed" for tag in self._open if tag not in OPTIONAL_END]

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        """Note what the element refers to."""
        values = {key: value or "" for key, value in attributes}
        if "id" in values:
            self.anchors.add(values["id"])
        if tag in SOURCES and SOURCES[tag] in values:
            self.links.append((tag, values[SOURCES[tag]]))
        self.headings += tag == "h1"
        self.viewport |= tag == "meta" and values.get("name") == "viewport"
        if tag == "img" and not values.get("alt"):
            self.problems.append(f"a picture without a text: {values.get('src')}")
        self.problems += [f"{FAULTS[name]} ({name})" for name in values.get("class", "").split() if name in FAULTS]
        if tag not in VOID:
            self._open.append(tag)

    def handle_startendtag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        """An element such as `<img/>`."""
        self.handle_starttag(tag, attributes)
        if tag not in VOID:
            self._open.pop()

    def handle_endtag(self, tag: str) -> None:
        """Close the element, and those in it whose end may be left out."""
        while self._open and self._open[-1] != tag and self._open[-1] in OPTIONAL_END:
            self._open.pop()
        if not self._open or self._open[-1] != tag:
            self.problems.append(f"</{tag}> at {self.getpos()[0]} closes {self._open[-1:] or 'nothing'}")
            return
        self._open.pop()


def problems_of(folder: Path, pages: dict[Path, Page]) -> list[str]:
    """Every problem of the pages, each with its page."""
    problems, linked = [], {folder / "index.html"}
    for path, page in pages.items():
        found = list(page.problems)
        for tag, address in page.links:
            url = urlsplit(address)
            if url.scheme or url.netloc:
                found += [f"loaded from the network: {address}"] if tag != "a" and url.scheme != "data" else []
                continue
            target = (path.parent / unquote(url.path)).resolve() if url.path else path
            linked |= {target} - {path}
            anchor = unquote(url.fragment)
            if not target.is_file() or (anchor and target in pages and anchor not in pages[target].anchors):
                found.append(f"{tag} leads nowhere: {address}")
        problems += [f"{path.relative_to(folder)}: {problem}" for problem in found]
    lost = [path for path in pages if path not in linked and path.name not in UNLINKED]
    return [*problems, *(f"{path.relative_to(folder)}: no page leads here" for path in lost)]


def main(folder: Path) -> int:
    """Check the site and return the exit code."""
    pages = {
        path: Page(path.read_text(encoding="utf-8"))
        for path in sorted(folder.rglob("*.html"))
        if "_static" not in path.parts
    }
    problems = problems_of(folder, pages)
    size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
    if size > LARGEST:
        problems.append(f"the site has {size / 1e6:.1f} MB, more than {LARGEST / 1e6:g} MB")
    print(f"{len(pages)} pages, {size / 1e6:.1f} MB, {len(problems)} problems", *problems, sep="\n")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]).resolve()))
