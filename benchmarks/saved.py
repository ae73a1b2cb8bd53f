"""What a run of the benchmarks found, as files that tables and pages are made from."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

from benchmarks.measure import Result

FOLDER = Path(__file__).parent / "results"


@dataclass
class Measured:
    """The results of one mechanism: `default` is the label of our default method there.

    `agreement` is the largest relative difference of the accelerations from ours, by simulator, and `left_out` says why
    a simulator was not measured. `measured` is the date, `load` that of the machine in the minute before, and `sample`
    the simulated time in s of each of the `rounds` samples.
    """

    mechanism: str
    default: str
    measured: str
    load: float
    rounds: int
    sample: float
    versions: list[str]
    agreement: dict[str, float] = field(default_factory=dict)
    left_out: dict[str, str] = field(default_factory=dict)
    results: list[Result] = field(default_factory=list)

    def result(self, label: str) -> Result | None:
        """The result with a label, if that was measured."""
        return next((result for result in self.results if result.label == label), None)


def save(found: Measured, folder: Path = FOLDER) -> None:
    """Write the results of a mechanism."""
    folder.mkdir(exist_ok=True)
    _file(found.mechanism, folder).write_text(json.dumps(asdict(found), indent=1), encoding="utf-8")


def load(name: str, folder: Path = FOLDER) -> Measured | None:
    """The last results of a mechanism, if there are any."""
    file = _file(name, folder)
    if not file.exists():
        return None
    data = json.loads(file.read_text(encoding="utf-8"))
    return Measured(**{**data, "results": [Result(**result) for result in data["results"]]})


def load_all(names: Sequence[str], folder: Path = FOLDER) -> Iterator[Measured]:
    """The last results of those mechanisms that have any, in the given order."""
    for name in names:
        if (found := load(name, folder)) is not None:
            yield found


def _file(name: str, folder: Path) -> Path:
    return folder / f"{name.replace(' ', '_').replace('+', '_')}.json"
