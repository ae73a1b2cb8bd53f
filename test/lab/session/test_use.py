"""Random use of the lab: whatever users do, the recording of it is recomputed bit for bit."""

import pytest

from mbd_sim.recordings.run.verification import verify
from test.lab.random_use import RandomUse

ROBOT = """<robot name="robot"><link name="base"/>
<link name="arm"><inertial><origin xyz="0 0 0.25"/><mass value="1.5"/>
<inertia ixx="0.11" iyy="0.12" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="hand"><inertial><origin xyz="0.1 0 0"/><mass value="0.5"/>
<inertia ixx="0.01" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="turn" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/></joint>
<joint name="bend" type="revolute"><parent link="arm"/><child link="hand"/><origin xyz="0 0 0.5"/><axis xyz="1 0 0"/>
<limit lower="-1.5" upper="1.5" effort="10" velocity="5"/><dynamics damping="0.1"/></joint></robot>"""


@pytest.mark.parametrize("name", ["four_bar", "bounce", "motor_drive", "robot"])
def test_a_recording_of_random_use_is_recomputed(name, tmp_path):
    if name == "robot":
        name = str(tmp_path / "source.urdf")
        (tmp_path / "source.urdf").write_text(ROBOT, encoding="utf-8")
    (tmp_path / "use").mkdir()
    user = RandomUse(name, tmp_path / "use", seed=3)
    user.session.record(tmp_path / "use" / "run.mcap")
    for _ in range(24):
        user.act(seconds=0.05)
    paths = user.recordings()
    assert len(paths) > 1
    for found in (found for path in paths for found in verify(path)):
        assert found.agrees, (found.first, found.failure)
        assert found.compared
        assert found.tolerance is None
