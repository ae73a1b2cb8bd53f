"""The root element of an XML file, by which its format is known."""

import pytest

from mbd_sim.files.xml.elements import root_tag


@pytest.mark.parametrize(
    ("text", "tag"),
    [
        ('<robot name="a"/>', "robot"),
        ('\ufeff<?xml version="1.0"?>\n<!-- <sdf> -->\n<mujoco><worldbody/></mujoco>', "mujoco"),
        ("<sdf><not closed", "sdf"),
        ("<!-- never closed", ""),
        ("<", ""),
        ("<robot>\ud800</robot>", ""),
    ],
)
def test_only_the_root_element_is_read(text, tag):
    assert root_tag(text) == tag
