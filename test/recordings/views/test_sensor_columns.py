"""Measurements in tables and plots: those that the simulation gives, at their own times, and held in each state."""

import numpy as np
import pytest

from mbd_sim import Simulation
from mbd_sim.cli.main import main
from mbd_sim.recordings.run.reader import open_recording
from mbd_sim.recordings.views.panels import panels
from mbd_sim.recordings.views.table import columns, read_table
from test.docs.notebooks import undrawn
from test.pictures.rerun.test_viewer import Recorded

CART = """
mechanism: measured_cart
sensor_seed: 5
ground: {points: {wall: {at: [3, 0, 0], rotate: {axis: [0, 1, 0], angle: -90 deg}}}}
parts:
  cart: {mass: 1}
  rod: {shape: {type: rod, to: [0, 0, 1], mass: 0.2}, points: {tip: [0, 0, 1]}}
joints:
  rail: {type: prismatic, between: [ground, cart], axis: [1, 0, 0], velocity: 0.4}
  hinge: {type: revolute, between: [cart, rod], axis: [0, 1, 0], position: 0.3}
actuators:
  motor: {type: dc_motor, joint: hinge, torque_constant: 0.05, resistance: 2, command: {voltage: 3}}
sensors:
  imu: {type: imu, at: rod.tip, rate: 200 Hz, delay: 3 ms, orientation: {}, specific_force: {noise_density: 0.01}}
  shock: {type: accelerometer, at: cart, rate: 100 Hz}
  load: {type: force_torque, joint: hinge, rate: 50 Hz, drop_out: 0.3}
  angle: {type: encoder, joint: hinge, counts: 512, index: 0, rate: 100 Hz}
  place: {type: encoder, joint: rail, resolution: 1 mm, rate: 100 Hz}
  speed: {type: tachometer, joint: rail, rate: 100 Hz, delay: 25 ms}
  wall: {type: range, at: cart, plane: ground.wall, most: 5, rate: 20 Hz}
  pose: {type: pose, at: rod.tip, rate: 25 Hz}
  twist: {type: twist, at: rod.tip, rate: 25 Hz}
  odometry: {type: odometry, at: cart, rate: 25 Hz}
  current: {type: current, actuator: motor, rate: 100 Hz}
"""
NAMES = ("imu", "shock", "load", "angle", "place", "speed", "wall", "pose", "twist", "odometry", "current")
RATE, STEPS = 200.0, 5  # of recorded states, and the number of steps between two of them


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A run with a reset in its middle: its table, and in each recorded state what `sensors()` gives."""
    path = tmp_path_factory.mktemp("sensors") / "run.mcap"
    simulation, found = Simulation.from_text(CART), []

    def follow(states):
        for _ in range(states):
            simulation.step(STEPS)
            found.append(simulation.sensors())

    with simulation.recording(path, rate=RATE):
        found.append(simulation.sensors())
        follow(60)
        simulation.reset()
        follow(30)
    return path, read_table(open_recording(path)), found


def test_each_sensor_has_its_measurements_at_their_own_times(run):
    _, table, _ = run
    assert set(table.sensors) == set(NAMES)
    imu, speed = table.sensors["imu"], table.sensors["speed"]
    np.testing.assert_allclose(imu.times - imu.sampled, 0.003, atol=1e-12)
    np.testing.assert_allclose(speed.times - speed.sampled, 0.025, atol=1e-12)
    assert np.diff(imu.sampled)[:50] == pytest.approx(0.005)
    assert {name: one.unit for name, one in imu.quantities.items()} == {
        "orientation": "",
        "angular_velocity": "rad/s",
        "specific_force": "m/s²",
    }
    units = {name: one.quantities[quantity].unit for name, quantity in (("angle", "position"), ("place", "position"),
             ("speed", "velocity"), ("current", "current"), ("wall", "distance"))
             for one in [table.sensors[name]]}  # fmt: skip
    assert units == {"angle": "rad", "place": "m", "speed": "m/s", "current": "A", "wall": "m"}


def test_columns_hold_the_last_measurement_that_has_arrived(run):
    _, table, found = run
    exported = columns(table)
    assert (len(found), len(table), table.resets) == (91, 92, (61,))  # the state after the reset is recorded, too
    rows = [row if row < 61 else row + 1 for row in range(91)]
    checked = 0
    for row, sensors in zip(rows, found, strict=True):
        for name in NAMES:
            prefix = f"sensor.{name}."
            own = {key.removeprefix(prefix): column[row] for key, column in exported.items() if key.startswith(prefix)}
            if name not in sensors:
                assert np.all(np.isnan(list(own.values())))
                continue
            for quantity, values in sensors[name].values.items():
                shown = [value for key, value in own.items() if key.startswith(quantity)]
                expected = np.roll(values, -1) if len(values) == 4 else values
                np.testing.assert_allclose(shown, expected, rtol=1e-6 if name == "wall" else 0, atol=0)
                checked += 1
    assert checked > 1000
    assert "sensor.imu.angular_velocity_x_rad_s" in exported and "sensor.load.torque_z_Nm" in exported
    assert "sensor.angle.position_rad" in exported and "sensor.angle.index" in exported


def test_a_panel_for_each_quantity_is_interrupted_at_a_reset(run, capsys):
    path, table, _ = run
    chosen = panels(table, ["sensors"])
    titles = [panel.title for panel in chosen]
    assert "imu: specific force" in titles and "angle: index" in titles and len(titles) == len(set(titles))
    (force,) = [panel for panel in chosen if panel.title == "imu: specific force"]
    assert [line.name for line in force.lines] == ["x", "y", "z"] and force.y_label == "specific force (m/s²)"
    (line, *_), measured = force.lines, table.sensors["imu"]
    assert len(line.x) == len(measured.times) + 1
    gap = int(np.flatnonzero(np.isnan(line.x))[0])
    assert measured.sampled[gap - 1] > 0.1 and measured.rows[gap] >= table.resets[0]
    out = path.with_suffix(".svg")
    with undrawn():
        main(["plot", str(path), "--out", str(out), "--show", "sensors", "--quiet"])
    assert "imu: specific force" in capsys.readouterr().out and out.exists()


def test_rerun_shows_the_measurements_of_a_recorded_run(run):
    path, table, _ = run
    shown = path.with_suffix(".rrd")
    assert main(["view", str(path), "--save", str(shown), "--quiet"]) == 0
    recorded = Recorded(shown)
    for sensor, quantity in (
        ("imu", "specific_force"),
        ("imu", "orientation"),
        ("speed", "velocity"),
        ("wall", "distance"),
    ):
        measured = table.sensors[sensor]
        np.testing.assert_array_equal(
            recorded.column(f"/sensors/{sensor}/{quantity}", "Scalars:scalars"), measured.quantities[quantity].values
        )
        times = [time for time, _ in recorded.rows[f"/sensors/{sensor}/{quantity}"]]
        np.testing.assert_allclose(times, measured.times, atol=1e-9)
    assert recorded.static["/sensors/imu/specific_force"]["SeriesLines:names"] == [["x", "y", "z"]]


def test_rerun_shows_the_measurements_of_a_run_as_it_is_computed(run, tmp_path):
    path, *_ = run
    (tmp_path / "sensed.yaml").write_text(open_recording(path).mechanism_text or "")
    shown = tmp_path / "live.rrd"
    assert main(["run", str(tmp_path / "sensed.yaml"), "--time", "0.05", "--rerun", str(shown), "--quiet"]) == 0
    recorded = Recorded(shown)
    simulation, found = Simulation.from_file(tmp_path / "sensed.yaml"), {}
    for _ in range(51):
        for number, sample in simulation.arrivals:
            reading = simulation.sensor_model.reading(number, sample)
            for quantity, values in reading.values.items():
                ordered = np.roll(values, -1) if quantity == "orientation" else values
                name = f"/sensors/{simulation.mechanism.sensors[number].name}/{quantity}"
                found.setdefault(name, []).append((simulation.time, ordered.tolist()))
        simulation.step()
    assert found.keys() >= {"/sensors/imu/specific_force", "/sensors/imu/orientation", "/sensors/speed/velocity"}
    for name, expected in found.items():
        times, values = zip(*expected, strict=True)
        np.testing.assert_array_equal(recorded.column(name, "Scalars:scalars"), values)
        np.testing.assert_allclose(recorded.times(name), times, atol=1e-9)


def test_a_run_without_sensors_has_no_such_plot(tmp_path):
    path = tmp_path / "run.mcap"
    simulation = Simulation.from_file("double_rod")
    with simulation.recording(path):
        simulation.step(20)
    table = read_table(open_recording(path))
    assert table.sensors == {} and not [name for name in columns(table) if name.startswith("sensor.")]
