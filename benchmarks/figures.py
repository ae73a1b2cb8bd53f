"""Writes the figures of the last `make bench` into the pages: docs/benchmarks.md, its picture, and README.md.

python -m benchmarks.figures

The numbers of the overview and of README.md are kept in benchmarks/summary.json, so that a test can compare them with
the pages. The page begins with benchmarks/preface.md, whose lines `<!-- NAME -->` stand for what a program printed.
"""

from __future__ import annotations

import json
import re
import shutil
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from benchmarks import saved
from benchmarks.everything import file_of
from benchmarks.mechanisms import MECHANISMS
from benchmarks.overview import overview, readme_speed, summary
from benchmarks.report import details

HERE = Path(__file__).resolve().parent
SUMMARY, PREFACE = HERE / "summary.json", HERE / "preface.md"
README, PAGE = HERE.parent / "README.md", HERE.parent / "docs" / "benchmarks.md"
PICTURE = "work_precision.png"
MARK = re.compile(r"^<!-- (\w+) -->$", re.MULTILINE)
SENTENCE = re.compile(r"(<!-- speed -->).*?(<!-- /speed -->)", re.DOTALL)


def with_sentence(text: str, numbers: Mapping[str, Any]) -> str:
    """README.md with the sentence on speed that follows from a summary.

    :raises ValueError: its marks are missing.
    """
    if len(SENTENCE.findall(text)) != 1:
        raise ValueError("README.md must contain <!-- speed --> and <!-- /speed --> once")
    return SENTENCE.sub(lambda marks: f"{marks[1]}{readme_speed(numbers)}{marks[2]}", text)


def page(preface: str, numbers: Mapping[str, Any], printed: Mapping[str, str], results: str) -> str:
    """docs/benchmarks.md: `printed` is what each program printed.

    :raises ValueError: nothing was kept of a program that the preface names.
    """

    def of(mark: re.Match[str]) -> str:
        name = mark[1]
        if name == "overview":
            return overview(numbers)
        if name not in printed:
            raise ValueError(f"{file_of(name)} does not exist. Run `make bench`.")
        text = printed[name].strip()
        return text if "\n|" in f"\n{text}" else f"```text\n{text}\n```"

    return f"{MARK.sub(of, preface)}\n{results}\n"


def main() -> int:
    """Write the pages."""
    measured = list(saved.load_all(list(MECHANISMS)))
    if missing := [name for name in MECHANISMS if name not in {found.mechanism for found in measured}]:
        print(f"Not measured yet: {', '.join(missing)}. Run `make bench`.", file=sys.stderr)
        return 1
    numbers = summary(measured)
    names = [name for name in MARK.findall(PREFACE.read_text(encoding="utf-8")) if file_of(name).exists()]
    printed = {name: file_of(name).read_text(encoding="utf-8") for name in names}
    text = page(PREFACE.read_text(encoding="utf-8"), numbers, printed, details(measured))
    readme = with_sentence(README.read_text(encoding="utf-8"), numbers)
    SUMMARY.write_text(json.dumps(numbers, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    PAGE.write_text(text, encoding="utf-8")
    README.write_text(readme, encoding="utf-8")
    if (picture := saved.FOLDER / PICTURE).exists():
        shutil.copyfile(picture, PAGE.parent / PICTURE)
    return 0


if __name__ == "__main__":
    sys.exit(main())
