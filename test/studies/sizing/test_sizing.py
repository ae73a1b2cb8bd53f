"""Sizing of drives against closed forms: of an inertia, a hoist, a slider-crank, a press, a balanced arm."""

import numpy as np
import pytest

from mbd_sim import InputError, parse_mechanism
from mbd_sim.studies.kinematic_analysis import driven_motion
from mbd_sim.studies.sizing import (
    GearType,
    LoadCycle,
    MotorType,
    balancing_spring,
    best_ratio,
    constant_speed,
    drive_cycles,
    flywheel,
    motion_law,
    motor_duty,
    spring_between,
)
from mbd_sim.studies.sizing.flywheel import load_beside, with_flywheel
from mbd_sim.studies.sizing.picture import draw_duty

CLOSE = 1e-9
MOTOR = MotorType(
    "test", 2e-4, ((0.0, 3.0), (500.0, 2.0)), ((0.0, 9.0),), 600.0, torque_constant=0.5, resistance=0.8, voltage=400.0,
    thermal_resistance=2.0, thermal_time=600.0, max_temperature=130.0,
)  # fmt: skip


def close(found, expected):
    assert found == pytest.approx(expected, rel=CLOSE, abs=CLOSE)


def trapezoid(inertia=0.03, travel=2.0, time=0.6, dwell=0.3, share=0.25):
    law = motion_law("trapezoid", time, 31, share=share, dwell=dwell)
    return law, LoadCycle.of_arrays(law.time, travel * law.rate, inertia * travel * law.acceleration, inertia=inertia)


def test_trapezoidal_motion_of_an_inertia():
    inertia, travel, time, dwell, share = 0.03, 2.0, 0.6, 0.3, 0.25
    _, load = trapezoid(inertia, travel, time, dwell, share)
    speed = travel / time / (1.0 - share)
    torque = inertia * speed / (share * time)
    close([load.peak, load.top_speed, load.position[-1]], [torque, speed, travel])
    close(load.rms, torque * np.sqrt(2.0 * share * time / (time + dwell)))
    close(load.work, (0.5 * inertia * speed**2, 0.5 * inertia * speed**2))
    ratio = best_ratio(load, MOTOR)
    close(ratio, np.sqrt(inertia / MOTOR.rotor_inertia))  # the inertias match
    duty = motor_duty(load, MOTOR, GearType("best", ratio))
    close([duty.inertia_ratio, duty.rms_torque], [1.0, 2.0 * load.rms / ratio])
    for other in (0.99 * ratio, 1.01 * ratio):
        assert motor_duty(load, MOTOR, GearType("other", other)).rms_torque > duty.rms_torque


def test_sinusoidal_motion_of_an_inertia_with_losses():
    inertia, a, w, n, efficiency = 0.05, 0.7, 6.0, 8.0, 0.9
    t = np.linspace(0.0, 2.0 * np.pi / w, 721)
    accelerations = -a * w**2 * np.sin(w * t)
    load = LoadCycle.of_arrays(t, a * w * np.cos(w * t), inertia * accelerations, acceleration=accelerations)
    derived = LoadCycle.of_arrays(t, load.speed, load.effort)
    assert np.max(np.abs(derived.acceleration - accelerations)) < CLOSE * a * w**2
    motor = MotorType("lossy", 2e-4, ((0.0, 3.0),), ((0.0, 9.0),), 600.0, 0.5, 0.8, temperature_coefficient=0.0)
    duty = motor_duty(load, motor, GearType("8", n, efficiency))
    amplitudes = [(2e-4 * n + inertia / n * loss) * a * w**2 for loss in (1.0 / efficiency, efficiency)]
    rms = np.sqrt(0.25 * (amplitudes[0] ** 2 + amplitudes[1] ** 2))
    close([duty.rms_torque, duty.peak_torque], [rms, max(amplitudes)])
    close(duty.copper_loss, 0.8 * (rms / 0.5) ** 2 * 2.0 * np.pi / w)
    close(duty.drawn - duty.returned, duty.copper_loss + n * a * (amplitudes[0] - amplitudes[1]))
    # By p = R i² + k i ω, with i = -i₀ sin and ω = ω₀ cos where it brakes: it returns energy while tan < k ω₀ / (R i₀).
    i, top = amplitudes[1] / 0.5, n * a * w
    end = np.arctan(0.5 * top / (0.8 * i))
    returned = (0.125 * i * top * (1.0 - np.cos(2.0 * end)) - 0.4 * i**2 * (end - 0.5 * np.sin(2.0 * end))) / w
    close(duty.returned, 2.0 * returned)


HOIST = """
mechanism: hoist
parameters: {r: 0.15, drum: 0.4, m: 80}
parts:
  drum: {mass: 20, inertia: [0.3, drum, 0.3]}
  load: {mass: m}
joints:
  winch: {type: revolute, between: [ground, drum], axis: [0, 1, 0]}
  lift: {type: prismatic, between: [ground, load], axis: [0, 0, 1]}
constraints:
  cable: {type: coupling, terms: {lift: 1, winch: -r}}
"""


def test_hoist_lifts_and_lowers():
    r, drum, m, g = 0.15, 0.4, 80.0, 9.81
    turns, time = 12.0, 3.0
    law = motion_law("trapezoid", time, 13, share=0.2, dwell=1.0, returns=True)
    motion = driven_motion(parse_mechanism(HOIST), {"winch": (0.0, turns)}, law.places)
    load = drive_cycles(motion, law)["winch"]
    weight, inertia = m * g * r, drum + m * r**2
    speed = turns / time / 0.8
    extra = inertia * speed / (0.2 * time)
    close(load.effort, weight + inertia * load.acceleration)
    close(load.inertia, inertia)
    close([load.peak, load.rms], [weight + extra, np.sqrt(weight**2 + extra**2 * 4 * 0.2 * time / (2 * time + 2.0))])
    close(load.work, (weight * turns, weight * turns))  # the weight also brakes the inertia at the top


SLIDER_CRANK = """
mechanism: slider_crank
parameters: {I: 0.02, r: 0.1, l: 0.3, m: 0.5}
gravity: [0, 0, 0]
parts:
  crank: {mass: 1, inertia: [I, I, I], points: {pin: [r, 0, 0]}}
  slider: {mass: m}
joints:
  crank: {type: revolute, between: [ground, crank], axis: [0, -1, 0], position: 0}
  guide: {type: prismatic, between: [ground, slider], axis: [1, 0, 0], position: r + l, guess: true}
constraints:
  conrod: {type: distance, between: [crank.pin, slider], length: l}
"""


def test_slider_crank_at_constant_speed():
    inertia, r, rod_length, m, w = 0.02, 0.1, 0.3, 0.5, 40.0
    motion = driven_motion(parse_mechanism(SLIDER_CRANK), {"crank": (0.0, 2.0 * np.pi)}, 121, speed=w)
    load = drive_cycles(motion)["crank"]
    sine, cosine = np.sin(motion.drive), np.cos(motion.drive)
    rod = np.sqrt(rod_length**2 - (r * sine) ** 2)
    slope = -r * sine - r**2 * sine * cosine / rod  # of the slider by the crank
    bend = -r * cosine - r**2 * (cosine**2 - sine**2) / rod - (r**2 * sine * cosine) ** 2 / rod**3
    close(load.inertia, inertia + m * slope**2)
    close(load.effort, m * slope * bend * w**2)
    # The energy swings by that of the slider, which is greatest where its speed is.
    fine = np.linspace(0.0, np.pi, 200_001)
    x = np.sqrt(rod_length**2 - (r * np.sin(fine)) ** 2)
    swing = 0.5 * m * w**2 * np.max((r * np.sin(fine) + r**2 * np.sin(fine) * np.cos(fine) / x) ** 2)
    wheel = flywheel(load, 0.01)
    assert wheel.swing == pytest.approx(swing, rel=1e-8)  # the maximum of a grid
    close([wheel.total, wheel.mean_effort], [wheel.swing / (0.01 * w**2), 0.0])


def test_flywheel_of_a_press_and_of_harmonic_torque():
    w, high, share = 20.0, 500.0, 0.2  # a press that needs its torque in a fifth of a turn
    turn = 2.0 * np.pi / w
    time = np.array([0.0, share, share, 1.0]) * turn
    press = LoadCycle.of_arrays(time, np.full(4, w), [high, high, 0.0, 0.0])
    wheel = flywheel(press, 0.05)
    close([wheel.mean_effort, wheel.swing], [share * high, share * (1 - share) * high * 2 * np.pi])
    close(wheel.inertia, wheel.swing / (0.05 * w**2))
    speeds = with_flywheel(press, wheel)
    close((speeds.max() - speeds.min()) / (0.5 * (speeds.max() + speeds.min())), 0.05)
    back = LoadCycle.of_arrays(time, np.full(4, -w), -press.effort)  # the other way round
    close(with_flywheel(back, flywheel(back, 0.05)), -speeds)
    heavy = LoadCycle.of_arrays(time, np.full(4, w), press.effort, inertia=0.3)
    wheel = flywheel(heavy, 0.05)
    beside = load_beside(heavy, wheel)
    close(beside.effort, np.full(4, wheel.mean_effort))
    close(motor_duty(beside, MOTOR, GearType("g", 10.0)).inertia_ratio, wheel.total / 100.0 / MOTOR.rotor_inertia)
    t = np.linspace(0.0, turn, 362)  # extremes between samples
    wave = LoadCycle.of_arrays(t, np.full(362, w), 30.0 + 12.0 * np.sin(3.0 * w * t))
    close(flywheel(wave, 0.02).swing, 2.0 * 12.0 / 3.0)
    with pytest.raises(InputError, match="does not turn in one direction"):
        flywheel(trapezoid()[1], 0.02)


def test_a_motor_that_keeps_the_speed_without_torque_has_no_panels(tmp_path):
    """Behind a flywheel whose load takes no energy on average: of torque, power and current there would be only zeros."""
    t = np.linspace(0.0, 1.0, 61)
    wave = LoadCycle.of_arrays(t, np.full(61, 2.0 * np.pi), np.sin(2.0 * np.pi * t))
    idle = load_beside(wave, flywheel(wave, 0.05))
    for load, panels in ((wave, True), (idle, False)):
        draw_duty(tmp_path / "a.svg", load, motor_duty(load, MOTOR))
        text = (tmp_path / "a.svg").read_text(encoding="utf-8")
        assert (">power<" in text, "it keeps the speed without torque" in text) == (panels, not panels)


def test_temperature_follows_the_losses():
    on, off, current = 20.0, 60.0, 8.0
    time = np.array([0.0, on, on, on + off])
    torque = 0.5 * np.array([current, current, 0.0, 0.0])
    load = LoadCycle.of_arrays(time, np.zeros(4), torque)
    tau, slope = MOTOR.thermal_time, MOTOR.resistance_slope
    heat = current**2 * MOTOR.resistance * MOTOR.thermal_resistance
    stiffness = 1.0 - heat * slope
    settled = heat * (1.0 + slope * (40.0 - 25.0)) / stiffness
    warm, cool = np.exp(-stiffness * on / tau), np.exp(-off / tau)
    hottest = settled * (1.0 - warm) / (1.0 - warm * cool)
    duty = motor_duty(load, MOTOR)
    close([duty.hottest, duty.temperature[0], duty.temperature[-1]], [40.0 + hottest] + [40.0 + hottest * cool] * 2)
    once = LoadCycle.of_arrays(time, np.zeros(4), torque, cyclic=False)
    close(motor_duty(once, MOTOR).temperature[1], 40.0 + settled * (1.0 - warm))
    hot = motor_duty(LoadCycle.of_arrays([0, 1], [0, 0], [9.0, 9.0]), MOTOR)  # the resistance grows without end
    assert hot.hottest == np.inf and not hot.suffices
    hopeless = motor_duty(LoadCycle.of_arrays([0, 100], [0, 0], [1e4, 1e4]), MOTOR)
    assert hopeless.hottest == np.inf


ARM = """
mechanism: arm
parameters: {m: 6, a: 0.4, h: 0.3, b: 0.2}
ground: {points: {hook: [0, 0, h]}}
parts:
  arm: {mass: m, center: [a, 0, 0], inertia: [0.1, 0.1, 0.1], points: {eye: [b, 0, 0]}}
joints:
  shoulder: {type: revolute, between: [ground, arm], axis: [0, -1, 0]}
"""


def test_a_spring_of_zero_free_length_balances_an_arm():
    m, a, h, b, g = 6.0, 0.4, 0.3, 0.2, 9.81
    motion = driven_motion(parse_mechanism(ARM), {"shoulder": (-1.0, 1.2)}, 25, speed=1e-3)
    load = drive_cycles(motion)["shoulder"]
    close(load.effort, m * g * a * np.cos(load.position))
    length, rate = spring_between(motion, "shoulder", "ground.hook", "arm.eye")
    for aim in ("rms", "peak"):
        found = balancing_spring(load, aim, length=length, rate=rate, rest=0.0)
        assert found.stiffness == pytest.approx(m * g * a / (h * b), rel=1e-8)
        assert found.load.peak < 1e-7 * load.peak
    both = balancing_spring(load, length=length, rate=rate)
    assert both.stiffness == pytest.approx(m * g * a / (h * b), rel=1e-6) and abs(both.rest) < 1e-6


def test_a_spring_at_the_joint_takes_what_is_proportional_to_its_angle():
    t = np.linspace(0.0, 2.0 * np.pi, 361)
    angle = 0.3 + 0.5 * np.sin(t)
    load = LoadCycle.of_arrays(
        t, 0.5 * np.cos(t), 7.0 - 20.0 * angle + np.cos(2.0 * t), position=angle, acceleration=-0.5 * np.sin(t)
    )
    found = balancing_spring(load)
    close([found.stiffness, found.rest], [20.0, 7.0 / 20.0])
    close(found.load.rms, np.sqrt(0.5))
    least = balancing_spring(load, "peak")
    assert least.load.peak < found.load.peak <= 1.0 + CLOSE
    with pytest.raises(InputError, match="no spring makes the rms effort"):
        balancing_spring(LoadCycle.of_arrays(t, load.speed, 20.0 * angle, position=angle))
    with pytest.raises(InputError, match="wound up in each cycle"):
        balancing_spring(LoadCycle.of_arrays(t, np.ones(361), angle, position=t))


def test_the_best_ratio_with_friction_and_a_speed_limit():
    _, load = trapezoid()
    load = load.with_effort(load.effort + 0.2 * np.sign(load.speed))
    motor = MotorType("rubbing", 2e-4, ((0.0, 3.0),), ((0.0, 9.0),), 600.0, coulomb=0.05, viscous=1e-4)
    ratio = best_ratio(load, motor, efficiency=0.8)
    torques = [motor_duty(load, motor, GearType("", k * ratio, 0.8)).rms_torque for k in (1 - 1e-4, 1.0, 1 + 1e-4)]
    assert torques[1] < min(torques[0], torques[2])
    slow = MotorType("slow", 1e-9, ((0.0, 3.0),), ((0.0, 9.0),), 50.0)
    close(best_ratio(load, slow), 50.0 / load.top_speed)
    rest = constant_speed(1.0, 11)
    assert best_ratio(LoadCycle.of_arrays(rest.time, rest.rate, np.ones(11)), slow) == 50.0


@pytest.mark.parametrize("kind", ["trapezoid", "harmonic", "cycloid", "polynomial"])
def test_laws_of_motion_fit_together(kind):
    law = motion_law(kind, 0.4, 61, dwell=0.1, returns=True)
    load = LoadCycle.of_arrays(law.time, law.rate, law.acceleration)
    assert np.max(np.abs(load.position - law.s)) < CLOSE  # s is the integral of its rate,
    spread = np.max(np.abs(load.acceleration - law.acceleration)) / np.max(np.abs(law.acceleration))
    assert spread < 1e-5  # and the acceleration the derivative of it
    assert law.places[0] == 0.0 and law.places[-1] == 1.0
