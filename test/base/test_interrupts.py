"""KeyboardInterrupt is raised where CasADi and Matplotlib do not drop it or replace it by an error of their own."""

from __future__ import annotations

import pathlib
import signal
import sys
import threading
from collections.abc import Iterator
from types import FrameType

import casadi
import numpy as np
import pytest
from matplotlib.backends.backend_agg import RendererAgg
from matplotlib.path import Path
from matplotlib.transforms import Affine2D

from mbd_sim import Simulation
from mbd_sim.analysis.mechanics import inverse_dynamics, kinematics
from mbd_sim.base.interrupts import interruptible, raise_interrupt
from mbd_sim.dynamics import equations
from mbd_sim.files.load import load_mechanism
from mbd_sim.pictures.drawing.picture import draw
from mbd_sim.studies.kinematic_analysis import system


class Interrupted(np.ndarray):
    """An array; a signal arrives when CasADi asks for its shape, and CasADi drops exceptions there."""

    @property
    def shape(self) -> tuple[int, ...]:  # type: ignore[override]
        signal.raise_signal(signal.SIGUSR1)
        return np.ndarray.shape.__get__(self)


class InterruptedNumber:
    """A number; a signal arrives when CasADi converts it, and CasADi raises an error of its own for exceptions there."""

    def __init__(self, number: signal.Signals = signal.SIGUSR1) -> None:
        self._number = number

    def __SX__(self) -> casadi.SX:  # noqa: N802
        signal.raise_signal(self._number)
        return casadi.SX(2.0)


# From Python 3.13 on, exceptions that CasADi drops are reported as unraisable.
pytestmark = pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")


@pytest.fixture(params=["at once", "where it is not lost"])
def is_safe(request: pytest.FixtureRequest) -> Iterator[bool]:
    """Whether the handler of the signal uses `raise_interrupt`."""
    safe = request.param != "at once"

    def interrupt(_: int, frame: FrameType | None) -> None:
        if not safe:
            raise KeyboardInterrupt
        raise_interrupt(frame)

    before, trace = signal.signal(signal.SIGUSR1, interrupt), sys.gettrace()
    yield safe
    signal.signal(signal.SIGUSR1, before)
    assert sys.gettrace() is trace


def test_an_interrupt_within_casadi_is_raised_after_the_call(is_safe: bool) -> None:
    reached = []

    def trace() -> None:
        value = casadi.SX(1.0) + np.ones(2).view(Interrupted)
        reached.append(value)

    if is_safe:
        with pytest.raises(KeyboardInterrupt):
            trace()
        assert not reached
    else:  # otherwise this test shows nothing
        trace()
        assert reached


def test_an_interrupt_within_casadi_is_not_reported_as_an_error(is_safe: bool) -> None:
    expected = KeyboardInterrupt if is_safe else NotImplementedError
    with pytest.raises(expected):
        raise AssertionError(casadi.sin(InterruptedNumber()))


class InterruptedTransform(Affine2D):
    """A transform; a signal arrives when Matplotlib's renderer reads it, which raises an error of its own then."""

    def __array__(self, *given: object, **named: object) -> np.ndarray:
        signal.raise_signal(signal.SIGUSR1)
        return super().__array__(*given, **named)


def test_an_interrupt_within_a_renderer_is_not_reported_as_an_error(is_safe: bool) -> None:
    renderer = RendererAgg(10.0, 10.0, 72.0)
    with pytest.raises(KeyboardInterrupt if is_safe else ValueError):
        renderer.draw_path(renderer.new_gc(), Path.unit_rectangle(), InterruptedTransform())


def test_an_interrupt_does_not_wait_for_a_library_that_calls_this_package() -> None:
    """As Matplotlib does for an animation in a window: its call returns when the window is closed."""
    window, step = {"__name__": "matplotlib.animation"}, {"__name__": "mbd_sim.simulation.run", "signal": signal}
    exec("def show(function): function(); ended.append(True)", window)
    exec("def step(): signal.raise_signal(signal.SIGUSR1); went_on.append(True)", step)
    window["ended"], step["went_on"] = [], []  # type: ignore[assignment]
    before = signal.signal(signal.SIGUSR1, lambda _, frame: raise_interrupt(frame))
    with pytest.raises(KeyboardInterrupt):
        window["show"](step["step"])  # type: ignore[operator]
    signal.signal(signal.SIGUSR1, before)
    assert not step["went_on"] and not window["ended"]


def test_an_interrupt_elsewhere_is_raised_at_once(is_safe: bool) -> None:
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGUSR1), pytest.fail("went on")


def test_an_interrupt_within_a_comprehension_ends_it(is_safe: bool) -> None:
    array = np.ones(2).view(Interrupted)
    reached: list[int] = []

    def trace() -> None:
        [reached.append(k) or casadi.SX(k) + array for k in range(5)]  # type: ignore[func-returns-value]

    if is_safe:
        with pytest.raises(KeyboardInterrupt):
            trace()
    else:
        trace()
    assert reached == ([0] if is_safe else [0, 1, 2, 3, 4])


def interrupted_at_the_end(is_handled: list[str]) -> None:
    """The call of CasADi is the last statement that the handlers protect."""
    try:
        casadi.sin(InterruptedNumber())
    except KeyboardInterrupt:
        is_handled.append("except")
        raise
    finally:
        is_handled.append("finally")
        is_handled.append("all of it")


def test_an_interrupt_is_raised_by_the_call_and_not_after_it(is_safe: bool) -> None:
    is_handled: list[str] = []
    with pytest.raises(KeyboardInterrupt if is_safe else NotImplementedError):
        interrupted_at_the_end(is_handled)
    assert is_handled == ["except", "finally", "all of it"][not is_safe :]


def test_whoever_traces_after_an_interrupt_is_not_interrupted(is_safe: bool) -> None:
    """Debuggers, and tools that measure coverage, trace the calls that are in progress too."""
    before = sys.gettrace()
    with pytest.raises(KeyboardInterrupt if is_safe else NotImplementedError):
        casadi.sin(InterruptedNumber())
    sys.settrace(lambda *_: None)
    frame: FrameType | None = sys._getframe()
    while frame is not None:
        assert before is not None or frame.f_trace is None
        frame = frame.f_back
    sys.settrace(before)


@pytest.fixture
def ctrl_c() -> Iterator[None]:
    """Python's own handler of SIGINT."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("ctrl_c")
def test_ctrl_c_in_a_script_is_not_lost_where_equations_are_traced() -> None:
    with pytest.raises(NotImplementedError):  # otherwise this test shows nothing
        casadi.sin(InterruptedNumber(signal.SIGINT))
    with pytest.raises(KeyboardInterrupt), interruptible():
        casadi.sin(InterruptedNumber(signal.SIGINT))
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.mark.usefixtures("ctrl_c", "own_builds")
def test_a_mechanism_is_traced_and_built_so(monkeypatch: pytest.MonkeyPatch) -> None:
    seen = []

    def note(_: object) -> None:
        seen.append(signal.getsignal(signal.SIGINT))

    monkeypatch.setattr(equations, "require_smooth", note)
    equations.derive(load_mechanism("rod_pendulum"))
    assert seen and seen[0] is not signal.default_int_handler
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.mark.usefixtures("ctrl_c")
@pytest.mark.parametrize(
    ("module", "called", "use"),
    [
        (kinematics, "trace", lambda: kinematics.Kinematics(load_mechanism("rod_pendulum"))),
        (inverse_dynamics, "trace", lambda: inverse_dynamics.InverseDynamics(load_mechanism("rod_pendulum"))),
        (
            system,
            "trace",
            lambda: system.KinematicSystem(load_mechanism("four_bar"), ["crank_pivot"]),
        ),
    ],
)
def test_whatever_traces_or_calls_casadi_in_scripts_does_so(module, called, use, monkeypatch) -> None:
    seen, original = [], getattr(module, called)

    def note(*given: object, **named: object) -> object:
        seen.append(signal.getsignal(signal.SIGINT))
        return original(*given, **named)

    monkeypatch.setattr(module, called, note)
    use()
    assert seen and seen[-1] is not signal.default_int_handler
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.mark.usefixtures("ctrl_c")
def test_pictures_are_drawn_so_in_scripts(monkeypatch: pytest.MonkeyPatch, tmp_path: pathlib.Path) -> None:
    """Frames of animations, drawings, and plots of runs."""
    simulation, seen, original = Simulation.from_file("rod_pendulum"), [], RendererAgg.draw_path

    def note(*given: object, **named: object) -> object:
        seen.append(signal.getsignal(signal.SIGINT))
        return original(*given, **named)

    monkeypatch.setattr(RendererAgg, "draw_path", note)
    draw(simulation.mechanism, simulation.poses(), tmp_path / "picture.png")
    simulation.animate(until=0.01)
    simulation.plot(until=0.02)
    assert seen and signal.default_int_handler not in seen


@pytest.mark.usefixtures("ctrl_c")
def test_handlers_of_a_program_stay() -> None:
    def own(*_: object) -> None:
        """Whatever the program does."""

    signal.signal(signal.SIGINT, own)
    with interruptible():
        assert signal.getsignal(signal.SIGINT) is own
    assert signal.getsignal(signal.SIGINT) is own
    signal.signal(signal.SIGINT, signal.default_int_handler)
    with interruptible():
        signal.signal(signal.SIGINT, own)
    assert signal.getsignal(signal.SIGINT) is own


@pytest.mark.usefixtures("ctrl_c")
def test_other_threads_leave_signals_alone() -> None:
    seen = []

    def trace() -> None:
        with interruptible():
            seen.append(signal.getsignal(signal.SIGINT))

    thread = threading.Thread(target=trace)
    thread.start()
    thread.join()
    assert seen == [signal.default_int_handler]
