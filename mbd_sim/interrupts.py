"""Raises KeyboardInterrupt where it is not lost.

CasADi calls Python methods of its arguments. It drops the exceptions that these raise, or replaces them by its own.
"""

from __future__ import annotations

import sys
from types import FrameType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from _typeshed import TraceFunction

_CASADI = "casadi."


def raise_interrupt(frame: FrameType | None) -> None:
    """Raise KeyboardInterrupt: at once, or if the program is within a call of CasADi, where this call returns.

    For handlers of signals, which run in the main thread.

    :param frame: where the signal has interrupted the program, the second argument of the handler.
    :raises KeyboardInterrupt:
    """
    outside = _outside_casadi(frame)
    if outside is frame:
        raise KeyboardInterrupt
    before = sys.gettrace()

    def interrupt(traced: FrameType, _event: str, _argument: Any) -> TraceFunction | None:
        if _outside_casadi(traced) is not traced:
            return None
        sys.settrace(before)
        raise KeyboardInterrupt

    sys.settrace(interrupt)
    while outside is not None:  # calls in progress are traced only if their frames say so
        outside.f_trace = interrupt
        outside = outside.f_back


def _outside_casadi(frame: FrameType | None) -> FrameType | None:
    """The innermost call among a frame and its callers from which no call of CasADi is in progress."""
    outside = frame
    while frame is not None:
        if frame.f_globals.get("__name__", "").startswith(_CASADI):
            outside = frame.f_back
        frame = frame.f_back
    return outside
