import multiprocessing
import time

import numpy as np
import pyarrow.csv
import pyarrow.parquet
import pytest

from mbd_sim.cli.main import main
from mbd_sim.many.sweep import runs

RODS = ["sweep", "double_rod", "--quiet", "--time", "0.2", "--method", "rk4"]
MANY = ["--vary", "l=uniform(0.5, 2)", "--vary", "joints.elbow.position=uniform(0, 90 deg)", "--draws", "12"]


def test_a_grid_becomes_a_table_and_a_picture(tmp_path, capsys):
    table, picture = tmp_path / "runs.parquet", tmp_path / "runs.png"
    grid = ["--vary", "l=0.5:2:4", "--vary", "efforts.elbow=0,1,2"]
    assert main([*RODS, *grid, "--out", str(table), "--plot", str(picture), "--show", "elbow.velocity"]) == 0
    read = pyarrow.parquet.read_table(table)
    assert read.num_rows == 12
    assert read["l"].to_pylist()[:4] == [0.5, 0.5, 0.5, 1.0]
    assert b"mechanism: double_rod" in read.schema.metadata[b"mechanism.yaml"]
    assert picture.read_bytes()[:4] == b"\x89PNG"
    assert "12 runs" in capsys.readouterr().out


@pytest.mark.parametrize("varied", [["--vary", "l=0.5:2:9"], ["--vary", "m=1"], [*MANY[:-1], "5"]])
def test_every_kind_of_sweep_can_be_drawn(tmp_path, varied):
    picture, history = tmp_path / "runs.svg", tmp_path / "history.csv"
    assert main([*RODS, *varied, "--plot", str(picture), "--histories", str(history), "--every", "0.05"]) == 0
    assert "<svg" in picture.read_text()
    assert pyarrow.csv.read_csv(history).column_names == ["run", "time", "shoulder", "elbow"]


@pytest.fixture
def cluster():
    """The address of a scheduler on loopback, with a worker, both in threads: what they send each other is serialized.

    That a fresh process finds all that a run needs shows in the processes here, which get the same tasks.
    """
    from distributed import LocalCluster

    options = {"host": "127.0.0.1", "protocol": "tcp", "dashboard_address": None}
    with LocalCluster(n_workers=1, threads_per_worker=1, processes=False, **options) as here:
        yield here.scheduler_address


def test_processes_here_and_workers_of_a_cluster_give_the_same_bits(tmp_path, monkeypatch, cluster):
    import dask

    monkeypatch.setattr(runs, "CHUNK", 5)
    here, there = tmp_path / "here.parquet", tmp_path / "there.parquet"
    with dask.config.set(num_workers=1):
        assert main([*RODS, *MANY, "--out", str(here)]) == 0
    assert main([*RODS, *MANY, "--out", str(there), "--scheduler", cluster]) == 0
    one, other = pyarrow.parquet.read_table(here), pyarrow.parquet.read_table(there)
    assert one["run"].to_pylist() == list(range(12))
    assert len(set(one["elbow.position"].to_pylist())) == 12
    assert one.column_names == other.column_names
    for name in one.column_names:
        assert np.array_equal(one[name].to_numpy(), other[name].to_numpy()), name


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--vary", "q=1"], "q: is not a key of this file"),
        (["--vary", "parameters.q=1:2"], "parameters.q: there is no 'q'"),
        (["--vary", "l=1", "--out", "runs.xlsx"], "Choose one of .csv, .parquet, .npz"),
        (["--vary", "l=1", "--plot", "nowhere/runs.png"], "there is no folder nowhere"),
        (["--vary", "l=1", "--plot", "runs.gif"], "Choose one of .png, .svg, .pdf"),
        (["--vary", "l=1", "--out", "nowhere/runs.csv"], "there is no folder nowhere"),
        (["--vary", "l=1", "--show", "elbow.speed"], "elbow.velocity"),
        (["--vary", "l=1", "--scheduler", "tcp://127.0.0.1:1"], "no Dask scheduler"),
    ],
)
def test_a_wrong_call_says_what_to_write(arguments, words, capsys):
    assert main([*RODS, *arguments]) == 1
    assert words in capsys.readouterr().err


def test_an_interrupt_ends_the_workers_at_once_and_no_processes_that_others_have_started_meanwhile():
    import dask

    before = {child.pid for child in multiprocessing.active_children()}
    with dask.config.set(num_workers=1), pytest.raises(KeyboardInterrupt), runs._local_workers() as pool:
        assert pool.submit(abs, -1).result() == 1
        waiting = pool.submit(time.sleep, 3600.0)
        (worker,) = [child for child in multiprocessing.active_children() if child.pid not in before]
        other = multiprocessing.get_context("spawn").Process(target=time.sleep, args=(3600.0,))
        other.start()
        raise KeyboardInterrupt
    try:
        assert not worker.is_alive() and waiting.done()
        assert other.is_alive()
    finally:
        other.kill()
        other.join()
