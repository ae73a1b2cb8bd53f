"""The cache on disk: what is stored is found, what is damaged is not used, and a missing disk is no error."""

import os
import subprocess
import sys
import tempfile
import warnings
from itertools import pairwise
from pathlib import Path

import pytest

from mbd_sim import CommandError, Simulation
from mbd_sim.base import disk_cache, operating_system
from mbd_sim.compiler.code import host_module, machine_code
from mbd_sim.simulation.model import builder


@pytest.fixture
def folder(tmp_path, monkeypatch, own_builds):
    monkeypatch.setenv("MBD_SIM_CACHE", str(tmp_path / "kernels"))
    return tmp_path / "kernels"


def test_what_is_stored_is_found(folder):
    assert disk_cache.load("name") is None
    disk_cache.store("name", b"code")
    assert disk_cache.load("name") == b"code"
    assert [path.name for path in folder.iterdir()] == ["name"]
    assert folder.stat().st_mode & 0o777 == 0o700


def test_names_depend_on_every_text():
    assert disk_cache.key("ab", "c") != disk_cache.key("a", "bc") != disk_cache.key("a", "bc", "")
    assert disk_cache.key("a", "b") == disk_cache.key("a", "b")


@pytest.mark.parametrize("damage", [b"", b"short", b"\0" * 36])
def test_a_damaged_file_counts_as_missing(folder, damage):
    disk_cache.store("name", b"code")
    (folder / "name").write_bytes(damage)
    assert disk_cache.load("name") is None


def test_a_flipped_bit_is_noticed(folder):
    disk_cache.store("name", b"code")
    content = bytearray((folder / "name").read_bytes())
    content[-1] ^= 1
    (folder / "name").write_bytes(content)
    assert disk_cache.load("name") is None


@pytest.mark.parametrize("none", ["", "0", "off"])
def test_without_a_folder_nothing_is_kept(monkeypatch, none):
    monkeypatch.setenv("MBD_SIM_CACHE", none)
    disk_cache.store("name", b"code")
    assert disk_cache.folder() is None and disk_cache.load("name") is None


def test_a_place_that_cannot_be_written_does_no_harm(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("not a folder")
    monkeypatch.setenv("MBD_SIM_CACHE", str(tmp_path / "file" / "kernels"))
    with pytest.warns(RuntimeWarning, match="nothing can be stored in the cache .*Not a directory"):
        disk_cache.store("name", b"code")
    disk_cache.store("name", b"code")  # says nothing more
    assert disk_cache.load("name") is None
    assert Simulation.from_file("rod_pendulum").steps == 0


def test_the_default_is_the_users_cache(monkeypatch):
    monkeypatch.delenv("MBD_SIM_CACHE", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", "/somewhere")
    assert disk_cache.folder() == Path("/somewhere/mbd_sim/kernels")


@pytest.mark.parametrize("relative", ["cache", "./cache", "../cache", "."])
def test_a_relative_cache_home_is_ignored(monkeypatch, relative):
    monkeypatch.delenv("MBD_SIM_CACHE", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", relative)
    monkeypatch.setenv("HOME", "/home/somebody")
    assert disk_cache.folder() == Path("/home/somebody/.cache/mbd_sim/kernels")


def test_other_systems_have_caches_of_their_own(monkeypatch):
    monkeypatch.delenv("MBD_SIM_CACHE", raising=False)
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setenv("HOME", "/Users/somebody")
    for name in [name for name in sys.modules if name.split(".")[0] == "platformdirs"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setattr(sys, "platform", "darwin")
    assert disk_cache.folder() == Path("/Users/somebody/Library/Caches/mbd_sim/kernels")


def writable(path, folder):
    path.chmod(0o666)


def writable_folder(path, folder):
    folder.chmod(0o777)


def group_folder(path, folder):
    os.chown(folder, -1, 12345)
    folder.chmod(0o770)


def foreign_file(path, folder):
    os.chown(path, 12345, -1)


def foreign_folder(path, folder):
    os.chown(folder, 12345, -1)


def writable_above(path, folder):
    folder.parent.chmod(0o777)


def foreign_above(path, folder):
    os.chown(folder.parent, 12345, -1)


def link(path, folder):
    path.rename(folder / "target")
    path.symlink_to(folder / "target")


def pipe(path, folder):
    path.unlink()
    os.mkfifo(path, 0o600)


def subfolder(path, folder):
    path.unlink()
    path.mkdir()


ROOT_ONLY = pytest.mark.skipif(os.geteuid() != 0, reason="only root can give files away")


@pytest.mark.parametrize(
    "plant",
    [
        writable, writable_folder, writable_above, link, pipe, subfolder,
        *(pytest.param(plant, marks=ROOT_ONLY) for plant in (group_folder, foreign_file, foreign_folder, foreign_above)),
    ],
)  # fmt: skip
def test_what_others_may_have_written_is_not_loaded(folder, plant):
    disk_cache.store("name", b"code")
    plant(folder / "name", folder)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        assert disk_cache.load("name") is None
        assert disk_cache.load("name") is None
    expected = 0 if plant in (link, pipe, subfolder) else 1  # of each reason once
    assert len(caught) == expected
    assert all("chmod go-w" in str(warning.message) for warning in caught)


@ROOT_ONLY
def test_the_administrator_makes_no_folder_in_the_home_of_another(tmp_path, monkeypatch):
    """It would lock the owner of the home out of the cache for ever."""
    os.chown(tmp_path, 12345, -1)
    monkeypatch.delenv("MBD_SIM_CACHE", raising=False)
    monkeypatch.delenv("XDG_CACHE_HOME", raising=False)
    monkeypatch.setenv("HOME", str(tmp_path))
    with pytest.warns(RuntimeWarning, match="another user owns"):
        disk_cache.store("name", b"code")
    assert list(tmp_path.iterdir()) == []


@ROOT_ONLY
def test_what_the_administrator_has_stored_serves_other_users(monkeypatch):
    """As in an image of a container, whose programs run as another user."""
    with tempfile.TemporaryDirectory() as home:
        Path(home).chmod(0o755)
        monkeypatch.setenv("MBD_SIM_CACHE", f"{home}/kernels")
        disk_cache.store("name", b"code")
        Path(home, "kernels").chmod(0o755)
        Path(home, "kernels", "name").chmod(0o644)
        monkeypatch.setattr(os, "geteuid", lambda: 12345)
        assert disk_cache.load("name") == b"code"
        Path(home, "kernels").chmod(0o777)
        with pytest.warns(RuntimeWarning, match="chmod go-w"):
            assert disk_cache.load("name") is None


@pytest.mark.parametrize("plant", [writable_folder, writable_above])
def test_nothing_is_stored_where_others_may_write(folder, plant):
    disk_cache.store("name", b"code")
    plant(folder / "name", folder)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        disk_cache.store("other", b"code")
    assert [path.name for path in folder.iterdir()] == ["name"]


def test_a_group_with_one_member_is_no_danger(folder, monkeypatch):
    monkeypatch.setattr(operating_system, "_is_private", lambda group: group == os.getgid())
    disk_cache.store("name", b"code")
    folder.chmod(0o775)
    assert disk_cache.load("name") == b"code"


def test_a_folder_may_be_a_link(folder, tmp_path, monkeypatch):
    disk_cache.store("name", b"code")
    (tmp_path / "link").symlink_to(folder)
    monkeypatch.setenv("MBD_SIM_CACHE", str(tmp_path / "link"))
    assert disk_cache.load("name") == b"code"


def test_those_not_used_for_longest_go_first(folder, monkeypatch):
    monkeypatch.setattr(disk_cache, "LARGEST", 3 * 132)
    for number, name in enumerate("abc"):
        disk_cache.store(name, b"x" * 100)
        os.utime(folder / name, (number, number))
    assert disk_cache.load("a") is not None  # which marks it as used
    disk_cache.store("d", b"x" * 100)
    assert sorted(path.name for path in folder.iterdir()) == ["a", "c", "d"]


def test_small_entries_make_room_now_and_then(folder, monkeypatch):
    """One of ten for entries of a tenth of `SMALL`: the cache is too large by ten of them on average, and then it is not."""
    monkeypatch.setattr(disk_cache, "LARGEST", 1000)
    monkeypatch.setattr(disk_cache, "SMALL", 1.0)
    counts = []
    for number in range(200):
        disk_cache.store(str(number), b"%100d" % number)
        counts.append(len(list(folder.iterdir())))
    assert 10 <= sum(now <= before for before, now in pairwise(counts)) <= 30
    assert min(counts[40:]) == 1000 // 132 < max(counts) < 1000 // 132 + 60
    assert disk_cache.load("199") is not None


def test_a_mechanism_is_compiled_once(folder, monkeypatch):
    first = Simulation.from_file("rod_pendulum")
    monkeypatch.setattr(host_module, "object_code", lambda *_: pytest.fail("compiled again"))
    second = Simulation.from_file("rod_pendulum")
    first.step(100)
    second.step(100)
    assert first.state.tobytes() == second.state.tobytes()


def test_live_values_of_a_model_from_the_cache_change_its_motion_alike(folder, monkeypatch):
    live = ("gravity[*]", "joints.*.damping")
    first = Simulation.from_file("rod_pendulum", live=live)
    other = Simulation.from_file("rod_pendulum", live=live[:1])
    assert len(first.inputs) > len(other.inputs)
    monkeypatch.setattr(builder, "build", lambda *_: pytest.fail("built again"))
    second = Simulation.from_file("rod_pendulum", live=live)
    assert second.live == first.live
    for each in (first, second, other):
        each.step(100)
        each.set_live({"gravity[2]": -3.7})
        each.step(100)
    assert first.state.tobytes() == second.state.tobytes()
    assert first.q == pytest.approx(other.q, rel=1e-12)
    with pytest.raises(CommandError, match="not a live value"):
        second.set_live({"parameters.l": 1.0})


def test_other_processors_have_kernels_of_their_own(folder, monkeypatch):
    Simulation.from_file("rod_pendulum")
    count = len(list(folder.iterdir()))  # the units of a kernel, a model, and the file that was read
    for module in (machine_code, host_module):
        monkeypatch.setattr(module, "host", lambda: ("generic", ""))
    Simulation.from_file("rod_pendulum")
    assert len(list(folder.iterdir())) == 2 * count - 1


def test_another_process_finds_it_and_gets_the_same_bits(folder):
    program = (
        "from mbd_sim.compiler.code import machine_code; machine_code.LEVEL = 0; from mbd_sim import Simulation; "
        "s = Simulation.from_file('rod_pendulum'); s.step(100); print(s.state.tolist())"
    )
    answers = []
    for _ in range(2):
        done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
        answers.append((done.stdout, sorted(path.name for path in folder.iterdir())))
    assert answers[0] == answers[1]
    assert len(answers[0][1]) > 2  # the units of the kernel, the model, and the file that was read


def test_processes_that_store_at_once_do_no_harm(folder):
    program = "from mbd_sim.base import disk_cache\nfor _ in range(40): disk_cache.store('name', b'code' * 1000)"
    writers = [subprocess.Popen([sys.executable, "-c", program]) for _ in range(3)]
    while any(writer.poll() is None for writer in writers):
        assert disk_cache.load("name") in (None, b"code" * 1000)
    assert all(writer.returncode == 0 for writer in writers)
    assert disk_cache.load("name") == b"code" * 1000
    assert [path.name for path in folder.iterdir()] == ["name"]
