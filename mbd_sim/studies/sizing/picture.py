"""A cycle as a picture: the load and the motor over time, and speed and torque within the curves of the motor."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from mbd_sim.base.errors import MbdSimError, cause_of
from mbd_sim.base.geometry.pose import Array
from mbd_sim.base.interrupts import interruptible
from mbd_sim.base.packages import require_packages
from mbd_sim.studies.kinematic_analysis.picture import RESOLUTION, require_picture_suffix
from mbd_sim.studies.sizing.cycle import LoadCycle
from mbd_sim.studies.sizing.duty import MotorDuty
from mbd_sim.studies.sizing.text import RPM

BLUE, ORANGE, GREEN, GRAY = "tab:blue", "tab:orange", "tab:green", "0.55"
STEADY = 0.02  # change of a curve, relative to its size, below which it is drawn from zero
NOTHING = 1e-9  # of the peak torque of a motor, up to which it exerts nothing
SETTINGS = {"svg.fonttype": "none", "pdf.fonttype": 42, "svg.hashsalt": "mbd_sim"}


@interruptible()
def draw_duty(
    path: str | Path,
    load: LoadCycle,
    duty: MotorDuty | None = None,
    before: LoadCycle | None = None,
    speed: Array | None = None,
) -> None:
    """Draw a load, and what a motor does for it, as .png, .svg or .pdf; one that does nothing has no panels.

    :param before: the load without a spring or a flywheel, to compare with.
    :param speed: the speed (n,) that a flywheel lets fluctuate, of which the irregularity is written.
    :raises MbdSimError: the file cannot be written.
    """
    path = Path(path)
    require_picture_suffix(path)
    require_packages("matplotlib", purpose="A picture")
    from matplotlib import style
    from matplotlib.figure import Figure

    title = load.name if duty is None else f"{load.name}: {duty.motor.name}, gear {duty.gear.name}"
    if duty is not None and duty.peak_torque <= NOTHING * float(duty.motor.peak(np.zeros(1))[0]):
        duty, title = None, f"{title}: it keeps the speed without torque"
    with style.context(["default", SETTINGS]):
        rows = 1 if duty is None else 3 if duty.motor.is_electric else 2
        figure = Figure(figsize=(10.5, 2.9 * rows + 0.4), layout="constrained")
        axes = figure.subplots(rows, 2, squeeze=False)
        _over_time(axes[0, 0], load.time, load.effort, f"effort of {load.name}", load.unit, BLUE)
        if before is not None:
            axes[0, 0].plot(before.time, before.effort, color=GRAY, linestyle="--", linewidth=1.0, label="before")
            axes[0, 0].legend(frameon=False, fontsize="small")
        _over_time(
            axes[0, 1], load.time, load.speed, f"speed of {load.name}", "rad/s" if load.rotation else "m/s", ORANGE
        )
        if speed is not None:
            _fluctuation(axes[0, 1], load, speed)
        figure.suptitle(title)
        if duty is not None:
            _cloud(axes[1, 0], duty)
            _over_time(axes[1, 1], duty.load.time, duty.power, "power", "W", GREEN)
            if duty.motor.is_electric:
                _currents(axes[2, 0], duty)
                _over_time(axes[2, 1], duty.load.time, duty.temperature, "temperature of the winding", "°C", "tab:red")
        try:
            figure.savefig(path, dpi=RESOLUTION)
        except OSError as error:
            raise MbdSimError(f"{path} cannot be drawn: {cause_of(error)}") from error


def _over_time(axes: Any, time: Array, values: Array, title: str, unit: str, color: str) -> None:
    axes.plot(time, values, color=color, linewidth=1.3)
    axes.set_title(title, fontsize="medium")
    axes.set(xlabel="time (s)", ylabel=unit)
    axes.grid(alpha=0.25)
    axes.ticklabel_format(axis="y", useOffset=False)
    largest = float(np.max(np.abs(values), initial=0.0))
    if np.all(np.isfinite(values)) and np.ptp(values) < STEADY * largest:
        axes.set_ylim(sorted((0.0, 1.15 * (largest if values[0] > 0.0 else -largest))))


def _fluctuation(axes: Any, load: LoadCycle, speed: Array) -> None:
    """The speed with a flywheel, and its extremes, on a scale that shows them."""
    lowest, highest = float(speed.min()), float(speed.max())
    irregularity = (highest - lowest) / abs(load.samples.mean(load.speed))
    axes.lines[0].set(color=GRAY, linestyle="--", label="mean" if np.ptp(load.speed) == 0.0 else "without flywheel")
    label = f"with the flywheel, irregularity {irregularity:.3g}"
    axes.plot(load.time, speed, color=ORANGE, linewidth=1.3, label=label)
    margin = 0.4 * max(highest - lowest, float(np.ptp(load.speed)), 1e-9 * abs(highest))  # room for the legend
    both = np.concatenate([speed, load.speed])
    axes.set_ylim(both.min() - 0.2 * margin, both.max() + margin)
    axes.legend(frameon=False, fontsize="small", loc="upper right")


def _cloud(axes: Any, duty: MotorDuty) -> None:
    """Speed and torque of the motor within its curves, and the point of mean speed and RMS torque."""
    motor = duty.motor
    speeds = np.linspace(0.0, max(motor.max_speed, duty.top_speed), 400)
    peak, continuous = motor.peak(speeds), motor.continuous(speeds)
    x = speeds * RPM
    axes.fill_between(x, peak, color=ORANGE, alpha=0.15, label="peak")
    axes.fill_between(x, continuous, color=GREEN, alpha=0.25, label="continuous")
    axes.plot(x, peak, color=ORANGE, linewidth=1.0)
    axes.plot(x, continuous, color=GREEN, linewidth=1.0)
    driving = duty.torque * duty.speed >= 0.0
    for rows, color, name in ((driving, BLUE, "driving"), (~driving, GRAY, "braking")):
        if np.any(rows):
            axes.plot(
                np.abs(duty.speed[rows]) * RPM, np.abs(duty.torque[rows]), ".", color=color, markersize=3, label=name
            )
    axes.plot(duty.mean_speed * RPM, duty.rms_torque, "D", color="black", markersize=6, label="RMS torque, mean speed")
    axes.set_title("speed and torque of the motor, magnitudes", fontsize="medium")
    axes.set(xlabel="speed (rpm)", ylabel="N·m")
    axes.grid(alpha=0.25)
    axes.legend(frameon=False, fontsize="small", loc="upper right")
    axes.set_ylim(0.0, 1.4 * max(float(peak.max()), duty.peak_torque))


def _currents(axes: Any, duty: MotorDuty) -> None:
    time = duty.load.time
    _over_time(axes, time, duty.current, "current and voltage", "A", BLUE)
    other = axes.twinx()
    other.plot(time, duty.voltage, color=ORANGE, linewidth=1.0)
    other.set_ylabel("V", color=ORANGE)
    axes.set_ylabel("A", color=BLUE)
