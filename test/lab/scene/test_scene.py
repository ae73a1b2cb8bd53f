"""The scene follows what changes while it is shown."""

import pytest

from mbd_sim import load_mechanism
from test.waiting import wait_until

pytest.importorskip("viser")


def test_a_spring_appears_with_its_stiffness():
    """Its line was one too many, which ended the thread that shows pictures."""
    from mbd_sim.lab.lab import Lab

    with Lab(load_mechanism("cart_pendulum"), port=0, running=False) as lab:
        scene = lab.page._scene
        before = len(scene._lines)
        for stiffness, lines in ((5.0, before + 1), (0.0, before)):
            lab.session.ask("value", lambda one, stiffness=stiffness: one.change("joints.rail.stiffness", stiffness))
            wait_until(
                lambda lines=lines: len(scene._lines) == lines, "the line", gone=lambda: not lab.page._thread.is_alive()
            )
