"""What the site contains besides the pages of `docs/`: pages generated from the code and from the mechanism files.

They are written to `docs/generated/` when Sphinx starts, and links of the other pages lead to them.
"""

from __future__ import annotations

import importlib.util
import re
import shutil
from pathlib import Path
from typing import Any

from site_pages import command_line, examples, gallery, links, parameters, python_interface

DOCS = Path(__file__).resolve().parent.parent
GENERATED = DOCS / "generated"
MATHJAX = "tex-svg-full.js"  # one file, with its fonts and all extensions


def generate(app: Any) -> None:
    """Write the generated pages; a page whose text is the same is not touched, so that Sphinx need not read it again."""
    pages: dict[str, str] = {}
    for part in (command_line, parameters, python_interface, gallery, examples):
        pages |= part.pages()
    for name, text in pages.items():
        path = GENERATED / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")
    for path in GENERATED.rglob("*.*"):
        if str(path.relative_to(GENERATED)) not in pages:
            path.unlink()


def relocate_links(app: Any, name: str, content: list[str]) -> None:
    """Point the links of a page of `docs/` to the pages of the site; generated pages have been treated before."""
    path = DOCS / f"{name}.md"
    if path.exists() and GENERATED not in path.parents:
        content[0] = links.relocated(content[0], path, path)


def offline_mathjax(app: Any, config: Any) -> None:
    """Let pages load MathJax from the site; without the package that contains it, they load it from the network."""
    if _mathjax() is not None:
        config.mathjax_path = f"mathjax/{MATHJAX}"


def copy_mathjax(app: Any, error: Exception | None) -> None:
    """Copy MathJax into the built site."""
    source = _mathjax()
    if error is None and source is not None and app.builder.format == "html":
        target = Path(app.outdir, "_static", "mathjax")
        target.mkdir(parents=True, exist_ok=True)
        shutil.copy(source, target / MATHJAX)


def escape_bars(app: Any, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    """Bars in docstrings are absolute values, not substitutions of reStructuredText."""
    lines[:] = [re.sub(r"\|(?=\w+\|)", r"\\|", line) for line in lines]


def _mathjax() -> Path | None:
    found = importlib.util.find_spec("sphinx-mathjax-offline")
    return Path(found.origin).parent / "static" / "mathjax" / MATHJAX if found and found.origin else None


def setup(app: Any) -> dict[str, Any]:
    """Called by Sphinx."""
    app.connect("config-inited", offline_mathjax)
    app.connect("builder-inited", generate)
    app.connect("source-read", relocate_links)
    app.connect("autodoc-process-docstring", escape_bars)
    app.connect("build-finished", copy_mathjax)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
