"""Catalogs of motors and gears: both formats, units, limits, and all problems of a file at once."""

import math

import numpy as np
import pytest

from mbd_sim import InputError, MechanismError
from mbd_sim.studies.sizing import read_catalog, shipped_catalog
from mbd_sim.studies.sizing.catalog import catalog_of

YAML = """
motors:
  big: {rotor_inertia: 2 kg*cm^2, continuous_torque: [[0, 3 N*m], [3000 rpm, 2 N*m]], peak_torque: 9 N*m, max_speed: 5000 rpm,
        torque_constant: 0.5 N*m/A, resistance: 0.8 ohm, voltage: 60 V, thermal_resistance: 2 K/W, max_temperature: 120 °C}
gears:
  screw: {lead: 5 mm, efficiency: 0.9, max_effort: 6 kN}
"""
CSV = """name,rotor_inertia,continuous_torque,peak_torque,max_speed,torque_constant,resistance,voltage,thermal_resistance,max_temperature
big,2 kg*cm^2,0: 3; 3000 rpm: 2 N*m,9,5000 rpm,0.5,0.8,60 V,2,120
"""


def test_both_formats_say_the_same(tmp_path):
    (tmp_path / "motors.csv").write_text(CSV, encoding="utf-8")
    (motor,) = catalog_of(YAML).motors.values()
    assert read_catalog(tmp_path / "motors.csv").motor("big") == motor
    assert motor.rotor_inertia == pytest.approx(2e-4) and motor.continuous_torque[1][0] == pytest.approx(100 * math.pi)
    assert catalog_of(YAML).gear("screw", linear=True).ratio == pytest.approx(2 * math.pi / 0.005)


def test_limits_between_points_and_at_the_voltage():
    motor = catalog_of(YAML).motor("big")
    assert motor.continuous(np.array([50.0 * math.pi])) == pytest.approx([2.5])
    assert motor.peak(np.array([0.0, 110.0, 121.0, 600.0])) == pytest.approx([9.0, 0.5 * 5.0 / 0.8, 0.0, 0.0])


def test_all_problems_are_named_with_their_lines(tmp_path):
    wrong = "motors:\n  a: {rotor_inertia: 1 kg, peak_torque: -1, max_sped: 3}\ngears:\n  g: {ratio: 2, lead: 1 mm, efficiency: 1.2}\n"
    with pytest.raises(MechanismError) as error:
        catalog_of(wrong, "m.yaml")
    text = str(error.value)
    for part in ("m.yaml:2: motors.a.rotor_inertia", "lacks 'max_speed'", "Did you mean 'max_speed'", "must be above 0",
                 "m.yaml:4: gears.g: needs either", "gears.g.efficiency: must be above 0 and up to 1"):  # fmt: skip
        assert part in text
    (tmp_path / "m.csv").write_text("name,ratio\nx,2\nx,3\n", encoding="utf-8")
    with pytest.raises(MechanismError, match=r"m.csv:3: gears.x: is given twice, first on line 2"):
        read_catalog(tmp_path / "m.csv")
    with pytest.raises(InputError, match="no motor 'bif'"):
        catalog_of(YAML).motor("bif")
    with pytest.raises(InputError, match="does not fit a load"):
        catalog_of(YAML).gear("screw", linear=False)


def test_shipped_motors_can_do_what_they_say():
    """Their continuous torque does not overheat them, and their voltage suffices at their speeds."""
    for motor in shipped_catalog().motors.values():
        for speed, torque in motor.continuous_torque:
            current = torque / motor.torque_constant
            resistance = motor.resistance * (1.0 + motor.resistance_slope * (motor.max_temperature - 25.0))
            hottest = 40.0 + current**2 * resistance * motor.thermal_resistance
            assert hottest < motor.max_temperature + 2.0
            assert motor.resistance * current + motor.torque_constant * speed <= motor.voltage
        assert motor.torque_constant * motor.max_speed < motor.voltage
