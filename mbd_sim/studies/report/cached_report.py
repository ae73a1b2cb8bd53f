"""Reports that were made before, from the cache on disk."""

from __future__ import annotations

from typing import Any

from mbd_sim.base.disk_cache import cached, casadi_version, records_digest
from mbd_sim.mechanism.mechanism import Mechanism


def cached_report(mechanism: Mechanism) -> dict[str, Any]:
    """The contents of `report`, found by everything that they depend on; a mechanism is built only if need be.

    :raises MechanismError: see `Simulation`.
    """

    def made() -> dict[str, Any]:
        from mbd_sim.simulation.run.simulation import BaseSimulation
        from mbd_sim.studies.report.mechanism_report import report

        return report(BaseSimulation(mechanism))

    return cached(made, "report", records_digest(mechanism), casadi_version())
