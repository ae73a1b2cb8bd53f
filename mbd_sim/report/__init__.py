"""The report of `mbd_sim check` about a mechanism, as data and as text."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mbd_sim.lazy_names import lazy_names

if TYPE_CHECKING:
    from mbd_sim.report.mechanism_report import report as report
else:
    __getattr__ = lazy_names(__name__, {"mechanism_report": ("report",)})
