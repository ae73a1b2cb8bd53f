"""Commands on a machine whose disks cannot be written: there is no folder for temporary files."""

import tempfile

import pytest

from mbd_sim.cli.main import main


@pytest.fixture
def read_only(monkeypatch, tmp_path):  # whose folder pytest makes before
    """No folder for temporary files is found; `writable` are those in which one can be made all the same."""
    writable = set()
    made = tempfile.TemporaryFile

    def temporary_file(*arguments, **options):
        if tempfile.tempdir not in writable:
            raise OSError("read-only file system")
        return made(*arguments, **options)

    def none_found():
        raise FileNotFoundError(2, "No usable temporary directory found")

    monkeypatch.setenv("MBD_SIM_CACHE", "off")
    monkeypatch.setattr(tempfile, "tempdir", None)
    monkeypatch.setattr(tempfile, "_get_default_tempdir", none_found)
    monkeypatch.setattr(tempfile, "TemporaryFile", temporary_file)
    return writable


@pytest.mark.parametrize(
    ("command", "said"),
    [
        (("run", "a01_simple_pendulum", "--time", "0.1"), "0.1 s in 100 steps"),
        (("verify", "a01_simple_pendulum", "--time", "0.1"), "a01_simple_pendulum: verified, bit for bit"),
    ],
)
def test_what_writes_no_file_needs_no_folder(read_only, capsys, command, said):
    assert main([*command, "--quiet"]) == 0
    assert said in capsys.readouterr().out


def test_temporary_files_go_beside_the_file_that_is_written(read_only, tmp_path):
    read_only.add(str(tmp_path))
    picture = tmp_path / "run.png"
    assert main(["plot", "a01_simple_pendulum", "--time", "0.1", "--quiet", "--out", str(picture)]) == 0
    assert tempfile.tempdir == str(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["run.png"]


def test_a_recording_is_written_where_it_is_wanted(read_only, tmp_path):
    out = tmp_path / "run.mcap"
    assert main(["run", "a01_simple_pendulum", "--time", "0.1", "--quiet", "--out", str(out)]) == 0
    assert main(["verify", str(out), "--quiet"]) == 0
