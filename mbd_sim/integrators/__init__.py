"""Integration methods as data: coefficients, orders and error estimates."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mbd_sim.lazy_names import lazy_names

if TYPE_CHECKING:
    from mbd_sim.integrators.methods import METHODS as METHODS
else:
    __getattr__ = lazy_names(__name__, {"methods": ("METHODS",)})
