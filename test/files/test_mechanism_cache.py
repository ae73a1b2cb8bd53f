"""Mechanism files in the cache on disk: the same mechanism, found only under the same conditions."""

import pytest

from mbd_sim import MechanismError, Simulation, load_mechanism, parse_mechanism
from mbd_sim.base import disk_cache
from test.generators.mechanisms import KINDS
from test.record_contents import contents

PENDULUM = """
mechanism: pendulum
parameters: {l: 0.5}
parts:
  rod: {mass: 1, shape: {type: rod, to: [l, 0, 0]}, points: {tip: [l, 0, 0]}}
joints:
  pivot: {type: revolute, between: [ground, rod], axis: [0, 1, 0]}
"""
URDF = '<robot name="arm"><link name="base"/><link name="arm"><inertial><mass value="{mass}"/><origin xyz="0.1 0 0"/>\
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="hinge" type="continuous">\
<parent link="base"/><child link="arm"/><axis xyz="0 1 0"/></joint></robot>'


@pytest.fixture
def folder(tmp_path, monkeypatch, own_builds):
    monkeypatch.setenv("MBD_SIM_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def entries(folder):
    return len(list(folder.iterdir())) if folder.exists() else 0


@pytest.mark.parametrize("name", KINDS)
def test_the_records_are_the_same(folder, name):
    read = load_mechanism(name)
    assert entries(folder) == 1
    assert contents(load_mechanism(name)) == contents(read)


def test_a_mechanism_from_the_cache_takes_changes(folder):
    parse_mechanism(PENDULUM)
    changed = Simulation(parse_mechanism(PENDULUM), set={"l": 0.8}, live=["l"])
    assert changed.mechanism.parameters == {"l": 0.8}
    changed.set_live({"l": 0.7})
    assert changed.live == {"l": 0.7}


def test_text_file_name_and_versions_distinguish(folder, monkeypatch):
    parse_mechanism(PENDULUM)
    parse_mechanism(PENDULUM)
    assert entries(folder) == 1
    assert parse_mechanism(PENDULUM.replace("0.5", "0.6")).parameters == {"l": 0.6}
    assert parse_mechanism(PENDULUM, "mine.yaml").source.file == "mine.yaml"
    assert entries(folder) == 3
    monkeypatch.setattr(disk_cache, "versions", lambda: "another NumPy")
    parse_mechanism(PENDULUM)
    assert entries(folder) == 4


def test_a_changed_module_is_another_version(monkeypatch, tmp_path):
    (tmp_path / "module.py").write_text("first = 1")
    monkeypatch.setattr(disk_cache, "__file__", str(tmp_path / "disk_cache.py"))
    versions = disk_cache.versions.__wrapped__
    first = versions()
    assert versions() == first
    (tmp_path / "module.py").write_text("second = 2")
    assert versions() != first


def reads_cached(monkeypatch, path, base=None):
    """The mechanism of a file that is in the cache, and nowhere else."""
    with monkeypatch.context() as patch:
        patch.setattr("mbd_sim.files.load._parsed", lambda *arguments: pytest.fail("the file is read again"))
        return load_mechanism(path, base)


@pytest.mark.parametrize("base", [None, "free"])
def test_a_urdf_that_was_read_before_is_not_read_again(folder, tmp_path, monkeypatch, base):
    (tmp_path / "arm.urdf").write_text(URDF.format(mass=1))
    read = load_mechanism(tmp_path / "arm.urdf", base)
    assert contents(reads_cached(monkeypatch, tmp_path / "arm.urdf", base)) == contents(read)
    other = load_mechanism(tmp_path / "arm.urdf", "free" if base is None else None)
    assert contents(other) != contents(read)
    assert entries(folder) == 2


def test_a_mechanism_from_the_cache_has_the_digest_of_the_one_that_was_read(folder):
    """By which its model is found in the second start."""
    text = URDF.format(mass=1)
    digests = {disk_cache.records_digest(parse_mechanism(text)) for _ in range(3)}
    assert len(digests) == 1


MODELS = {
    "arm.urdf": (URDF, "arm.yaml", "urdf: arm.urdf\njoints: {hinge: {damping: 0.1}}"),
    "arm.xml": (
        '<mujoco><worldbody><body name="arm"><inertial pos="0.1 0 0" mass="{mass}" diaginertia="1 1 1"/>'
        '<joint name="hinge" axis="0 1 0"/></body></worldbody></mujoco>',
        "model.xml",
        '<mujoco><include file="arm.xml"/></mujoco>',
    ),
}


@pytest.mark.parametrize("name", MODELS)
def test_what_depends_on_another_file_is_read_again_when_that_changes(folder, tmp_path, monkeypatch, name):
    model, outer, text = MODELS[name]
    (tmp_path / outer).write_text(text)
    for mass in (1, 2):
        (tmp_path / name).write_text(model.format(mass=mass))
        assert load_mechanism(tmp_path / outer).parts["arm"].mass == mass
        assert reads_cached(monkeypatch, tmp_path / outer).parts["arm"].mass == mass
    assert entries(folder) == 1
    (tmp_path / name).unlink()
    with pytest.raises(MechanismError, match=r"there is no such file|Error opening file 'arm\.xml'"):
        load_mechanism(tmp_path / outer)


def test_an_sdf_whose_models_are_searched_for_is_read_each_time(folder, tmp_path, monkeypatch):
    link = '<link name="arm"><inertial><mass>{mass}</mass></inertial></link>'
    alone = f'<sdf version="1.9"><model name="arm">{link.format(mass=1)}</model></sdf>'
    (tmp_path / "arm.sdf").write_text(alone)
    load_mechanism(tmp_path / "arm.sdf")
    assert reads_cached(monkeypatch, tmp_path / "arm.sdf").parts["arm"].mass == 1.0
    assert entries(folder) == 1
    (tmp_path / "world.sdf").write_text(
        '<sdf version="1.9"><world name="w"><include><uri>model://arm</uri></include></world></sdf>'
    )
    for place, mass in (("first", 2), ("second", 3)):
        (tmp_path / place / "arm").mkdir(parents=True)
        (tmp_path / place / "arm" / "model.sdf").write_text(alone.replace("<mass>1", f"<mass>{mass}"))
        monkeypatch.setenv("SDF_PATH", str(tmp_path / place))
        assert load_mechanism(tmp_path / "world.sdf").parts["arm"].mass == mass
    assert entries(folder) == 1


def test_a_file_with_an_error_is_refused_again(folder):
    for _ in range(2):
        with pytest.raises(MechanismError, match="weight"):
            parse_mechanism(PENDULUM.replace("mass: 1", "weight: 1"))
    assert entries(folder) == 0
