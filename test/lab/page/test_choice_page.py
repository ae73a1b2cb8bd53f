"""The page on which joints are chosen, in a real browser: a joint is taken, the mechanism runs, and the way back."""

import numpy as np
import pytest

from mbd_sim.lab.joints.import_lab import ImportLab
from test.lab.joints.test_import_lab import chosen, imported
from test.waiting import wait_until

AnyPage = pytest.importorskip("test.lab.page.browser_page").AnyPage


def test_a_user_takes_a_joint_builds_and_goes_back(tmp_path, chromium):
    found = imported(tmp_path / "m.yaml")
    with ImportLab(found, chosen(found), port=0) as lab:
        page, first = AnyPage(chromium, lab.url, ready="Build"), lab.page
        box = first._types[1]
        page.select("1: frame – arm.left", "hinge (found)", lambda: box.value == "hinge (found)", "the choice")
        wait_until(lambda: first._told.content.startswith("1 joint taken"), "what is taken")
        page.press("Build", lambda: lab.lab is not None, "the mechanism", first=60.0)
        page.press("Play", lambda: lab.lab.session.frame.time > 0.0, "the run")
        names = lab.lab.session.bench.simulation.coordinate_names
        assert names == ("frame_arm.left",)
        page.press("Choose other joints", lambda: lab.lab is None, "the way back", first=60.0)
        page.page.get_by_role("button", name="Build").wait_for()
        assert np.isclose(lab.page._opacity.value, 1.0) and not page.errors
        page.page.close()
