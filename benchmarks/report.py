"""The detailed results: a table for each mechanism."""

from __future__ import annotations

from collections.abc import Sequence

from benchmarks.engines import NAMES
from benchmarks.saved import Measured
from benchmarks.table import costs, markdown, scientific


def details(measured: Sequence[Measured]) -> str:
    """Versions, the costs of all simulators on all mechanisms, and a section for each mechanism."""
    versions = f"**Versions:** {', '.join(measured[-1].versions)}."
    table = costs({found.mechanism: found.results for found in measured})
    return "\n\n".join([versions, table, *(section(found) for found in measured)])


def section(found: Measured) -> str:
    """A mechanism: the table of its simulators, how their accelerations agree, and which were left out."""
    differences = [f"{NAMES[module]} {scientific(value)}" for module, value in found.agreement.items()]
    lines = [f"## {found.mechanism}", markdown(found.results, found.default)]
    lines.append(f"Largest relative difference of accelerations from ours: {', '.join(differences)}.")
    if found.left_out:
        reasons: dict[str, list[str]] = {}
        for label, why in found.left_out.items():
            reasons.setdefault(why, []).append(label)
        lines.append(" ".join(f"Not measured ({why}): {', '.join(labels)}." for why, labels in reasons.items()))
    return "\n\n".join(lines)
