"""Results of sizing as text and as columns."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from mbd_sim.base.geometry.pose import Array
from mbd_sim.studies.sizing.cycle import LoadCycle
from mbd_sim.studies.sizing.duty import MotorDuty
from mbd_sim.studies.sizing.flywheel import ROUND_OFF, Flywheel
from mbd_sim.studies.sizing.springs import BalancingSpring

RPM = 30.0 / math.pi
WIDTH = 19  # of the column of names


def load_lines(load: LoadCycle) -> Iterator[str]:
    """The load in a cycle."""
    unit = load.unit
    speeds = (
        f"{load.top_speed:.6g} rad/s ({load.top_speed * RPM:.4g} rpm)" if load.rotation else f"{load.top_speed:.6g} m/s"
    )
    done, back = load.work
    yield _line("Load", f"{load.name}: {load.duration:.6g} s" + (", again and again" if load.cyclic else ", once"))
    yield _line("Speed", f"up to {speeds}")
    yield _line(
        "Effort", f"peak {load.peak:.6g} {unit}, RMS {load.rms:.6g} {unit}, mean {_mean(load, load.effort):.6g} {unit}"
    )
    power = f"{float(load.power.min()):.6g} to {float(load.power.max()):.6g} W"
    yield _line("Power", f"{power}, mean {_mean(load, load.power):.6g} W")
    yield _line(
        "Work", f"{done:.6g} J done and {back:.6g} J given back by the load" + (" in a cycle" if load.cyclic else "")
    )
    if not math.isnan(load.mean_inertia):
        kind = "kg·m²" if load.rotation else "kg"
        spread = f"from {float(load.inertia.min()):.6g} to {float(load.inertia.max()):.6g} {kind}"
        yield _line("Inertia", f"mean {load.mean_inertia:.6g} {kind}, {spread}")


def spring_lines(spring: BalancingSpring, before: LoadCycle, where: str = "") -> Iterator[str]:
    """A balancing spring, and what it saves."""
    load = spring.load
    linear = bool(where) or not load.rotation
    stiffness, rest = ("N/m", "m") if linear else ("N·m/rad", "rad")
    where = where or f"at {load.name}"
    yield _line("Spring", f"{where}: {spring.stiffness:.6g} {stiffness}, without force at {spring.rest:.6g} {rest}")
    for name, old, new in (("peak", before.peak, load.peak), ("RMS", before.rms, load.rms)):
        yield _line("", f"{name} effort {old:.6g} -> {new:.6g} {load.unit}")


def flywheel_lines(wheel: Flywheel) -> Iterator[str]:
    """A flywheel, and what it follows from."""
    yield _line(
        "Flywheel",
        f"{wheel.inertia:.6g} kg·m² for an irregularity of {wheel.irregularity:g} at {wheel.speed:.6g} rad/s",
    )
    yield _line("", "on a shaft that turns n times as fast, 1/n² of it does the same")
    present = f", of which the mechanism has {wheel.present:.6g}" if wheel.present else ""
    yield _line("", f"it stores {wheel.swing:.6g} J; {wheel.total:.6g} kg·m² are needed at the shaft{present}")
    yield _line("", f"the drive exerts {wheel.mean_effort:.6g} N·m all the time")


def _mean(load: LoadCycle, values: Array) -> float:
    """The mean over time, 0 in place of round-off."""
    mean = load.samples.mean(values)
    return mean if abs(mean) > ROUND_OFF * float(np.max(np.abs(values))) else 0.0


def _line(name: str, text: str) -> str:
    return f"{name:{WIDTH}s} {text}"


def ordered(duties: Sequence[MotorDuty]) -> list[MotorDuty]:
    """Those that suffice first, the one that is used most before the others; then those that are exceeded least."""
    return sorted(duties, key=_rank)


def _rank(duty: MotorDuty) -> tuple[bool, float, float]:
    """Where two can do nothing at their speeds, the other limits decide."""
    share, known = duty.most_used[1], [one for one in duty.uses.values() if math.isfinite(one)]
    return not duty.suffices, -share if duty.suffices else share, max(known, default=math.inf)


def duty_columns(duties: Sequence[MotorDuty]) -> dict[str, list[object]]:
    """A table with a row for each motor with its gear."""
    found: dict[str, list[object]] = {
        "motor": [one.motor.name for one in duties],
        "gear": [one.gear.name for one in duties],
        "ratio": [f"{one.gear.ratio:.4g}" for one in duties],
        "peak_Nm": [f"{one.peak_torque:.4g}" for one in duties],
        "RMS_Nm": [f"{one.rms_torque:.4g}" for one in duties],
        "rpm": [f"{one.top_speed * RPM:.5g}" for one in duties],
    }
    for name, values in (
        ("inertias", [one.inertia_ratio for one in duties]),
        ("A_peak", [one.peak_current for one in duties]),
        ("A_RMS", [one.rms_current for one in duties]),
        ("V", [one.peak_voltage for one in duties]),
        ("copper_J", [one.copper_loss for one in duties]),
        ("°C", [one.hottest for one in duties]),
        ("drawn_J", [one.drawn for one in duties]),
        ("back_J", [one.returned for one in duties]),
    ):
        if not all(math.isnan(value) for value in values):
            found[name] = ["–" if math.isnan(value) else f"{value:.4g}" for value in values]
    found["most used"] = [_most_used(one) for one in duties]
    found[""] = ["suffices" if one.suffices else "no" for one in duties]
    return found


def _most_used(duty: MotorDuty) -> str:
    name, share = duty.most_used
    return f"{name} {100.0 * share:.3g} %" if math.isfinite(share) else name


def duty_series(duty: MotorDuty) -> dict[str, Array]:
    """The cycle of the load and of a motor as columns (n,) over time."""
    load = duty.load
    effort = "Nm" if load.rotation else "N"
    return {
        **load_series(load),
        f"{load.name}.effort_with_gear_{effort}": duty.gear.ratio * duty.torque,
        "motor.speed_rad_s": duty.speed,
        "motor.torque_Nm": duty.torque,
        "motor.current_A": duty.current,
        "motor.voltage_V": duty.voltage,
        "motor.power_W": duty.power,
        "motor.temperature_C": duty.temperature,
    }


def load_series(load: LoadCycle) -> dict[str, Array]:
    """The cycle of a load as columns (n,) over time, which `read_cycle` reads."""
    angle, effort, inertia = ("rad", "Nm", "kgm2") if load.rotation else ("m", "N", "kg")
    return {
        "time_s": load.time,
        f"{load.name}.position_{angle}": load.position,
        f"{load.name}.velocity_{angle}_s": load.speed,
        f"{load.name}.acceleration_{angle}_s2": load.acceleration,
        f"{load.name}.effort_{effort}": load.effort,
        f"{load.name}.inertia_{inertia}": load.inertia,
    }
