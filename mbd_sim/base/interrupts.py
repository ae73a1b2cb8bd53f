"""Raises KeyboardInterrupt where it is not lost.

CasADi and the renderers of Matplotlib, which are written in C++, call Python methods of their arguments. They drop the
exceptions that these raise, or replace them by their own.
"""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from _typeshed import TraceFunction

_LIBRARIES = ("casadi.", "matplotlib.")
_OWN = "mbd_sim."


def raise_interrupt(frame: FrameType | None) -> None:
    """Raise KeyboardInterrupt: at once, or if the program is within a call of a library, where this call returns.

    For handlers of signals, which run in the main thread.

    :param frame: where the signal has interrupted the program, the second argument of the handler.
    :raises KeyboardInterrupt:
    """
    call = _library_call(frame)
    if call is None:
        raise KeyboardInterrupt
    _interrupt_in(call, at_return=True)


def repeat_interrupt(lost: sys.UnraisableHookArgs) -> None:
    """Raise KeyboardInterrupt again where Python would report and drop it, as in a destructor; for `unraisablehook`."""
    if not issubclass(lost.exc_type, KeyboardInterrupt):
        sys.__unraisablehook__(lost)
        return
    caller = sys._getframe(1)
    call = _library_call(caller)
    _interrupt_in(call or caller, at_return=call is not None)


def _interrupt_in(call: FrameType, *, at_return: bool) -> None:
    """Raise KeyboardInterrupt where a call in progress returns, or as soon as it goes on."""

    def interrupt(traced: FrameType, event: str, _argument: Any) -> TraceFunction | None:
        if traced is not call:
            return None
        if event == "return" or not at_return:  # or an exception leaves it, which this one replaces
            raise KeyboardInterrupt  # which ends the tracing
        return interrupt

    call.f_trace = interrupt  # calls in progress are traced only if their frames say so
    sys.settrace(interrupt)


@contextmanager
def interruptible() -> Iterator[None]:
    """Lose no Ctrl-C in this context, in scripts and notebooks: the main thread, with Python's own handler of SIGINT.

    Other handlers stay, as their programs decide what Ctrl-C does. Also a decorator.
    """
    is_main = threading.current_thread() is threading.main_thread()
    if not is_main or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
        yield
        return
    signal.signal(signal.SIGINT, _on_interrupt)
    try:
        yield
    finally:
        if signal.getsignal(signal.SIGINT) is _on_interrupt:
            signal.signal(signal.SIGINT, signal.default_int_handler)


def _on_interrupt(_: int, frame: FrameType | None) -> None:
    raise_interrupt(frame)


def _library_call(frame: FrameType | None) -> FrameType | None:
    """The outermost call of such a library among a frame and its callers, up to the first one of this package."""
    found = None
    while frame is not None and not (name := frame.f_globals.get("__name__", "")).startswith(_OWN):
        if name.startswith(_LIBRARIES):
            found = frame
        frame = frame.f_back
    return found
