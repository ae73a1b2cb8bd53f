"""The site: it builds without warnings, every page is sound, and it works in a browser on a phone's width.

`make docs` builds the site and runs these tests on it. Elsewhere they build one without executing its notebooks, which other tests
do, if the packages for it are installed in `.venv-docs`.
"""

import os
import subprocess
from pathlib import Path

import pytest

from test.docs.notebooks import cells
from test.docs.site_browser import browser, visited

ROOT = Path(__file__).resolve().parents[2]
PYTHON = ROOT / ".venv-docs" / "bin" / "python"


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    if "MBD_SIM_SITE" in os.environ:
        return Path(os.environ["MBD_SIM_SITE"]).resolve()
    if not PYTHON.exists():
        pytest.skip("the site is not built: `make docs` installs Sphinx, builds the site and runs these tests")
    folder = tmp_path_factory.mktemp("site")
    options = [
        "-b",
        "html",
        "-d",  # by default within the site, whose size is checked
        tmp_path_factory.mktemp("doctrees"),
        "-q",
        "-W",
        "--keep-going",
        "-D",
        "nb_execution_mode=off",
        "-D",
        "suppress_warnings=misc.highlighting_failure",
    ]
    done = subprocess.run(
        [PYTHON, "-m", "sphinx", *options, "docs", folder], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return folder


@pytest.mark.xdist_group("site")
def test_pages_links_and_pictures_are_sound(site):
    done = subprocess.run(
        [os.sys.executable, ROOT / "docs" / "check_site.py", site], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout


@pytest.mark.skipif(
    "MBD_SIM_SITE" not in os.environ or os.environ.get("MBD_SIM_NOTEBOOKS") == "off",
    reason="only `make docs` executes the notebooks of the site",
)
def test_every_plot_of_the_tutorials_is_on_the_site(site):
    plots = 0
    for source in sorted((ROOT / "docs" / "learn").glob("*.md")):
        drawing = sum(
            "plt.xlabel" in cell or "set_xlabel" in cell for cell in cells(source.read_text(encoding="utf-8"))
        )
        shown = (site / "learn" / f"{source.stem}.html").read_text(encoding="utf-8").count('<img alt="../_images/')
        assert shown >= drawing, f"{source.name}: {shown} of {drawing} plots"
        plots += drawing
    assert plots > 12


@pytest.mark.xdist_group("site")
def test_pages_work_in_a_browser_and_fit_on_a_phone(site, tmp_path):
    program = browser()
    if program is None:
        pytest.skip("there is no browser: install chromium, or name one in MBD_SIM_TEST_BROWSER")
    pages = sorted(str(path.relative_to(site)) for path in site.rglob("*.html") if "_static" not in path.parts)
    mechanisms = [page for page in pages if page.startswith("generated/gallery/") and not page.endswith("index.html")]
    opened = [page for page in pages if page not in mechanisms[3:] and page != "search.html"]
    found = visited(program, site, [*opened, "search.html?q=damping"], tmp_path)
    assert found is not None, "the browser did not finish"
    broken = {
        page: values
        for page, values in found.items()
        if values["failures"] or values["unloaded"] or values["wrong_formulas"] or values["overflow"] > 0
    }
    assert not broken
    assert len(found) == len(opened) + 1
    assert found["search.html?q=damping"]["hits"] > 3
