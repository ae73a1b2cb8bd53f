"""The snippets of README.md, the theory and the how-to pages run, each page from top to bottom in a folder of its own."""

from pathlib import Path

import pytest
from matplotlib import pyplot as plt

from mbd_sim.analysis.equilibria import equilibrium
from mbd_sim.cli.main import main
from mbd_sim.exports.fmu import archive
from mbd_sim.studies.kinematic_analysis import modes
from mbd_sim.studies.synthesis import global_search, minimizers, synthesis
from test.docs.notebooks import execute_snippet, snippets, undrawn

ROOT = Path(__file__).resolve().parents[2]
README = ROOT / "README.md"
THEORY = ROOT / "docs/explain/theory.md"
PAGES = [
    README,
    THEORY,
    ROOT / "docs/kinematic_analysis.md",
    ROOT / "docs/linear_analysis.md",
    ROOT / "docs/mjcf_sdf.md",
    ROOT / "docs/synthesis.md",
    *sorted(path for path in (ROOT / "docs" / "how_to").glob("*.md") if path.name != "index.md"),
]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_the_snippets_of_a_page_run(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for module, name, few in (
        (equilibrium, "ATTEMPTS", 2), (global_search, "POLISHED", 1), (modes, "LEAST", 30), (modes, "BATCH", 30),
        (synthesis, "FINER", 2), (minimizers, "GAIN", 1e-3), (minimizers, "TOLERANCE", 1e-3),
    ):  # fmt: skip
        monkeypatch.setattr(module, name, few)
    monkeypatch.setattr(archive, "FLAGS", tuple(flag.replace("-O3", "-O0") for flag in archive.FLAGS))
    with undrawn():
        for language, code in snippets(page.read_text(encoding="utf-8")):
            execute_snippet(language, code)
    plt.close("all")


def test_the_readme_is_short():
    assert len(README.read_text(encoding="utf-8").splitlines()) < 150


def test_the_readme_quotes_the_report_on_its_mechanism(tmp_path, monkeypatch, capsys):
    text = README.read_text(encoding="utf-8")
    (mechanism,) = [code for language, code in snippets(text) if language == "yaml"]
    quoted = text.split("```\nDegrees of freedom", 1)[1].split("\n```", 1)[0].splitlines()
    monkeypatch.chdir(tmp_path)
    Path("linkage.yaml").write_text(mechanism, encoding="utf-8")
    main(["check", "linkage.yaml"])
    printed = capsys.readouterr().out
    assert len(quoted) > 8
    assert not [line for line in quoted if line != "…" and line not in printed]
