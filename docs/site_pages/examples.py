"""Pages that lie elsewhere in the repository: those of the examples, for contributors, and the changelog."""

from __future__ import annotations

from pathlib import Path

from site_pages.links import GENERATED, ROOT, relocated

ELSEWHERE = {"contributing.md": ROOT / "CONTRIBUTING.md", "tests.md": ROOT / "test" / "README.md"}


def pages() -> dict[str, str]:
    """The pages by their names in `docs/generated/`."""
    examples = {
        f"examples/{path.parent.name}.md": path for path in sorted((ROOT / "mbd_sim" / "examples").glob("*/README.md"))
    }
    copied = {name: _copied(path, GENERATED / name) for name, path in {**examples, **ELSEWHERE}.items()}
    return {**copied, "changelog.rst": (ROOT / "CHANGELOG.rst").read_text(encoding="utf-8")}


def _copied(source: Path, page: Path) -> str:
    return relocated(source.read_text(encoding="utf-8"), source, page)
