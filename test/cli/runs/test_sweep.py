"""`mbd_sim sweep` without a file prints its results."""

from mbd_sim.cli.main import main


def test_the_results_are_printed_where_no_file_is_written(capsys, tmp_path):
    arguments = ["sweep", "a01_simple_pendulum", "--vary", "gravity[2]=-9:-8:25", "--time", "0.05", "--quiet"]
    assert main(arguments) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[1].split() == ["run", "gravity[2]", "x.position", "z.position"]
    assert len(lines) == 2 + 20 + 1 and lines[2].split()[:2] == ["0", "-9"]
    assert lines[-1].startswith("5 runs and ") and lines[-1].endswith("more: --out FILE.csv writes all")
    assert main([*arguments, "--quantity", "energies.kinetic"]) == 0
    header = capsys.readouterr().out.splitlines()[1].split()
    assert header[:2] == ["run", "gravity[2]"] and all(name.startswith("energies.kinetic.") for name in header[2:])
    assert main([*arguments, "--out", str(tmp_path / "t.csv")]) == 0
    assert "x.position" not in capsys.readouterr().out
