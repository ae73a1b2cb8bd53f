"""One browser, and one page of a linkage that the tests of panels share."""

import pytest

from mbd_sim import load_mechanism
from mbd_sim.lab.lab import Lab
from test.docs.site_browser import FLAGS, browser
from test.waiting import wait_until


@pytest.fixture(scope="package")
def chromium():
    pytest.importorskip("viser")
    playwright = pytest.importorskip("playwright.sync_api")
    if browser() is None:
        pytest.skip("there is no browser: install chromium, or name one in MBD_SIM_TEST_BROWSER")
    with playwright.sync_playwright() as program:
        opened = program.chromium.launch(executable_path=browser(), args=list(FLAGS))
        yield opened
        opened.close()


@pytest.fixture(scope="package")
def linkage(chromium, tmp_path_factory):
    """The page of a copy of the four-bar linkage; tests use `opened`."""
    from test.lab.page.browser_page import LARGE, BrowserPage

    folder = tmp_path_factory.mktemp("lab")
    file = folder / "linkage.yaml"
    file.write_text(load_mechanism("four_bar").source.text, encoding="utf-8")
    with Lab(load_mechanism(file), port=0, running=False) as lab:
        page = BrowserPage(chromium, lab, LARGE)
        yield page
        page.close()


@pytest.fixture
def opened(linkage, tmp_path, monkeypatch):
    """The page of the linkage, paused at its start; recordings go to a folder of the test."""
    monkeypatch.chdir(tmp_path)
    session = linkage.lab.session

    def begin(session):
        session.pause()
        session.set_speed(1.0)
        session.reset()
        session.tell("")

    session.ask("begin", begin)
    wait_until(lambda: not session.frame.running and session.frame.time == 0.0, "the start")
    assert not linkage.errors
    return linkage
