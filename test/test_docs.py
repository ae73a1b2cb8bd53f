"""The pages: links and anchors resolve, paths exist, and docs/architecture.md has the order of the folders."""

import functools
import re
import shlex
import sys
from pathlib import Path

import pytest

from mbd_sim.cli.main import build_parser, main
from mbd_sim.ros.stepping.realtime import SWITCH_INTERVAL
from mbd_sim.simulation.run.moving_points import MovingFrame, MovingPoint
from mbd_sim.simulation.run.present_state import PresentState
from mbd_sim.simulation.run.simulation import BaseSimulation
from test.test_architecture import ORDER

ROOT = Path(__file__).resolve().parent.parent
PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    ROOT / "test" / "README.md",
    *sorted(path for path in ROOT.glob("docs/**/*.md") if not {"_build", "generated"} & set(path.parts)),
    *sorted(ROOT.glob("mbd_sim/examples/*/README.md")),
    ROOT / "benchmarks" / "preface.md",
]
GUIDES = [ROOT / "CONTRIBUTING.md", ROOT / "docs" / "architecture.md", ROOT / "docs" / "engine.md"]
SOURCES = [path for folder in ("mbd_sim", "test", "config") for path in (ROOT / folder).rglob("*.*")]
LINK = re.compile(r"\]\((?!https?:|mailto:)([^)\s]+)\)")
ANY_CODE = re.compile(r"^```.*?^```$|`[^`\n]*`", re.MULTILINE | re.DOTALL)


def name_of(path):
    return str(path.relative_to(ROOT))


@functools.cache
def anchors(page):
    """The anchors that GitHub gives to the headings of a page."""
    text = re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    found = set()
    for heading in re.findall(r"^#+ +(.*)$", text, re.MULTILINE):
        plain = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).strip().lower()
        slug = re.sub(r"[^\w\- ]", "", plain).replace(" ", "-")
        repeats = sum(other == slug or re.fullmatch(re.escape(slug) + r"-\d+", other) is not None for other in found)
        found.add(slug if not repeats else f"{slug}-{repeats}")
    return found


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_links_and_anchors_resolve(page):
    # benchmarks/preface.md is the beginning of docs/benchmarks.md.
    folder = ROOT / "docs" if page.name == "preface.md" else page.parent
    broken = []
    for link in LINK.findall(ANY_CODE.sub("", page.read_text(encoding="utf-8"))):
        path, _, anchor = link.partition("#")
        target = (folder / path).resolve() if path else page
        if not target.exists() or (anchor and anchor not in anchors(target)):
            broken.append(link)
    assert not broken


@pytest.mark.parametrize("page", GUIDES, ids=name_of)
def test_paths_in_the_guides_exist(page):
    """Words in backticks that begin with a folder of the repository or the package are paths, with * as in the shell.

    Those that `make docs` writes need not be there.
    """
    text = page.read_text(encoding="utf-8")
    code = re.findall(r"`([^`\n]+)`", re.sub(r"^```.*?^```$", "", text, flags=re.MULTILINE | re.DOTALL))
    tops = {path.name for path in [*ROOT.iterdir(), *(ROOT / "mbd_sim").iterdir()]}
    missing = []
    for word in {word for span in code for word in span.split()}:
        if "/" in word and word.split("/")[0] in tops and "<" not in word and "…" not in word:
            path = word.split("::")[0]
            if not path.startswith("docs/generated/") and not [*ROOT.glob(path), *(ROOT / "mbd_sim").glob(path)]:
                missing.append(word)
    assert not missing


@pytest.mark.parametrize("page", GUIDES[:2], ids=name_of)
def test_classes_and_constants_in_the_guides_exist(page):
    names = re.findall(r"`([A-Z]\w+)`", page.read_text(encoding="utf-8"))
    assert len(names) > 5 and [name for name in names if name not in words_of_sources()] == []


@functools.cache
def words_of_sources():
    texts = (path.read_text("utf-8") for path in SOURCES if path.suffix == ".py")
    return frozenset().union(*(re.findall(r"\w+", text) for text in texts))


def blocks(page, language=""):
    """The code blocks of a page in a language."""
    found = re.findall(r"^```(\w*)\n(.*?)^```$", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
    return [text for name, text in found if name == language]


def commands(page):
    """The command lines of `mbd_sim` in the shell blocks of a page."""
    lines = "".join(blocks(page, "sh")).replace("\\\n", " ").splitlines()
    return [line.strip() for line in lines if re.match(r"\s*(\.venv/bin/)?mbd_sim ", line)]


def test_the_pages_show_every_command():
    shown = {line.split()[1] for page in PAGES for line in commands(page)}
    assert {"check", "run", "sweep", "verify", "rerun-with", "view", "plot", "export", "urdf", "convert"} <= shown


parser = functools.cache(build_parser)


@pytest.mark.parametrize("line", sorted({line for page in PAGES for line in commands(page)}))
def test_command_lines_in_the_pages_are_valid(line):
    words = shlex.split(line, comments=True)[1:]
    parser().parse_args(words[: words.index(">")] if ">" in words else words)


def test_the_first_tutorial_quotes_errors(tmp_path, monkeypatch, capsys):
    page = ROOT / "docs" / "learn" / "first_mechanism.md"
    (quoted,) = [block for block in blocks(page) if block.startswith("my_pendulum.yaml:")]
    text = re.search(r"^(mechanism: my_pendulum\n.*?)^```$", page.read_text("utf-8"), re.MULTILINE | re.DOTALL)[1]
    monkeypatch.chdir(tmp_path)
    Path("my_pendulum.yaml").write_text(text, encoding="utf-8")
    assert main(["check", "my_pendulum.yaml"]) == 0
    Path("my_pendulum.yaml").write_text(text.replace(" axis:", " axs:"), encoding="utf-8")
    assert main(["check", "my_pendulum.yaml"]) == 1
    printed = capsys.readouterr().err.splitlines()
    for line, start in zip(printed, quoted.splitlines(), strict=True):
        assert line.startswith(start.removesuffix("…"))


def test_engine_md_has_the_switch_interval_of_the_code():
    text = (ROOT / "docs" / "engine.md").read_text(encoding="utf-8")
    assert f"`sys.setswitchinterval` is {1e3 * SWITCH_INTERVAL:g} ms" in text


def test_documents_that_sources_mention_exist():
    named = re.compile(r"(?<![\w/.])((?:[\w-]+/)*[\w-]+\.(?:md|rst))\b")
    folders = (ROOT, ROOT / "docs", ROOT / "benchmarks")
    missing = {
        (name_of(path), page)
        for path in SOURCES
        if path.suffix in {".py", ".yaml"} and path != Path(__file__)
        for line in path.read_text(encoding="utf-8").splitlines()
        if ".md" in line or ".rst" in line
        for page in named.findall(line)
        if not any((folder / page).exists() for folder in (*folders, path.parent))
    }
    assert not missing


def layers():
    """Folders and modules of the package, in the order of the table in docs/architecture.md."""
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    return [name.removesuffix(".py") for name in re.findall(r"^\| `mbd_sim/([\w.]+)/?` \|", text, re.MULTILINE)]


def test_every_folder_of_the_package_is_described():
    there = {
        path.stem for path in (ROOT / "mbd_sim").iterdir() if (path / "__init__.py").exists() or path.suffix == ".py"
    }
    assert set(layers()) == there - {"__init__", "__main__"}


def test_the_order_of_the_folders_is_that_which_imports_follow():
    assert layers() == [name for name in reversed(ORDER) if name != "__main__"]


def names_in(member):
    """The names in the code of a method."""
    return getattr(getattr(member, "__code__", None), "co_names", ())


def test_the_page_of_kinematics_runs_every_function_that_it_names():
    """Each name in the first column is called while the page runs, and each public name of these classes is there."""
    text = (ROOT / "docs" / "api_kinematics.md").read_text(encoding="utf-8")
    (snippet,) = re.findall(r"^```python\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    called = set()

    def note(frame, event, _):
        if event == "call" and "mbd_sim/simulation" in frame.f_code.co_filename:
            called.add(frame.f_code.co_name)

    profiler = sys.getprofile()
    sys.setprofile(note)
    try:
        exec(compile(snippet, "docs/api_kinematics.md", "exec"), {})
    finally:
        sys.setprofile(profiler)
    rows = re.findall(r"^\| (`.*?) \|", text, re.MULTILINE)
    named = {
        name for row in rows if row != "`Simulation`" for name in re.findall(r"\.?([a-z_]+)(?:\([^)]*\))?(?=`|\.)", row)
    }
    named |= set(re.findall(r"(?<!\[)`(?:sim\.)?([a-z_]+)(?:\([^`]*\))?`", text)) & set(dir(BaseSimulation))
    assert len(named) > 20 and not sorted(named - called)
    public = {name for kind in (MovingPoint, MovingFrame) for name in vars(kind) if name[0] != "_"}
    terms = {name for name, member in vars(PresentState).items() if "_dynamics" in names_in(member)} - {"_begin"}
    assert len(terms) > 8 and not (public | terms) - called


CITED = re.compile(
    r"\b([A-ZÅÉÖÄ][\w'’-]*[a-zåäöéüł])(?:,? (?:and|&) ([A-Z]\w+[a-z]))?(?: et al\.)? \(?((?:18|19|20)\d\d)\b(?!-)"
)
DATES = {"January", "February", "March", "April", "May", "June", "July", "August", "September", "October", "November", "December"}  # fmt: skip


def test_works_that_are_cited_by_author_and_year_are_in_the_bibliography():
    """Of shipped mechanisms, sources and tests; a work that is cited without its year is not found."""
    entries = re.split(r"\n- ", (ROOT / "docs" / "bibliography.md").read_text(encoding="utf-8"))
    missing = set()
    for path in SOURCES:
        if path.suffix in (".py", ".yaml"):
            for first, second, year in CITED.findall(path.read_text(encoding="utf-8")):
                listed = any(first in entry and second in entry and year in entry for entry in entries)
                if first not in DATES and not listed:
                    missing.add(f"{name_of(path)}: {first} {second} {year}")
    assert not missing, "\n".join(sorted(missing))
