"""Densities and masses of the parts of an assembly, from a table of materials by their names."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

from mbd_sim.base.errors import InputError, listed, nearest, quoted
from mbd_sim.files.text.library import read_text
from mbd_sim.files.text.units import parse_value
from mbd_sim.files.text.yaml_text import parse_source
from mbd_sim.imports.assembly import CadAssembly, ImportedPart, PlacedBody
from mbd_sim.mechanism.mass_properties import MassProperties, composite
from mbd_sim.mechanism.values.materials import ALSO, MATERIALS, density_of
from mbd_sim.mechanism.values.names import split_assignment


@dataclass(frozen=True)
class Material:
    """A density in kg/m³, and the `name` of its material if it has one."""

    density: float
    name: str = ""

    def __str__(self) -> str:
        number = f"{self.density:g} kg/m³"
        return f"{self.name} ({number})" if self.name else number


@dataclass(frozen=True)
class MassTable:
    """Materials, and masses in kg, by names of parts, in which * stands for any letters; the last match counts."""

    materials: tuple[tuple[str, Material], ...] = ()
    masses: tuple[tuple[str, float], ...] = ()

    def material_of(self, part: ImportedPart, placed: PlacedBody) -> Material | None:
        """The material of a body, None if the table has none."""
        found = [material for pattern, material in self.materials if _fits(pattern, part, placed)]
        return found[-1] if found else None

    def mass_of(self, part: ImportedPart) -> float | None:
        """The mass of a part, None if the table gives none."""
        found = [mass for pattern, mass in self.masses if any(_fits(pattern, part, body) for body in part.bodies)]
        return found[-1] if found else None

    def properties(self, part: ImportedPart) -> MassProperties:
        """Mass, center and inertia of a part in its frame.

        :raises InputError: the table has neither its mass nor all its materials.
        """
        mass, found = self.mass_of(part), []
        for placed in part.bodies:
            material = self.material_of(part, placed)
            if material is None and mass is None:
                message = f"neither density nor mass of {part.name} is known"
                raise InputError(message, f"Add --density steel, for all parts, or --density '{part.name}=steel'.")
            density = 1.0 if material is None else material.density
            found.append(placed.body.volume.scaled(density).placed(placed.pose))
        whole = composite(found)
        return whole if mass is None else whole.scaled(mass / whole.mass)

    def require_used(self, assembly: CadAssembly) -> None:
        """Check that each line of the table fits a part.

        :raises InputError: one fits none.
        """
        for pattern in [pattern for pattern, _ in (*self.materials, *self.masses)]:
            bodies = [(part, body) for part in assembly.parts for body in part.bodies]
            if not any(_fits(pattern, part, body) for part, body in bodies):
                names = [part.name for part in assembly.parts]
                raise InputError(f"no part is called {quoted(pattern)}", nearest(pattern, names))


def _fits(pattern: str, part: ImportedPart, placed: PlacedBody) -> bool:
    return any(fnmatchcase(name, pattern) for name in (part.name, *placed.names))


def mass_table(densities: Sequence[str], masses: Sequence[str], file: Path | None) -> MassTable:
    """The table of options, whose lines count after those of a file, and general ones before those with names.

    :param densities: each a material or a number, or `name=` before it.
    :param masses: each `name=` and a number in kg.
    :param file: a YAML file that maps names to materials or numbers.
    :raises InputError: an entry is wrong.
    :raises MechanismError: the file is no YAML.
    """
    entries = [] if file is None else _entries(file)
    given = [("*", text) if "=" not in text else split_assignment(text) for text in densities]
    materials = sorted(given, key=lambda entry: entry[0] != "*")
    weights = []
    for text in masses:
        name, value = split_assignment(text)
        if not value:
            raise InputError(f"--mass {text}: a name and a mass are needed", "Write for example --mass 'rod*=0.3 kg'.")
        weights.append((name, _positive(value, "kg", f"--mass {text}")))
    return MassTable(
        tuple((name, material(value, where)) for name, value, where in entries)
        + tuple((name, material(value, f"--density {value}")) for name, value in materials),
        tuple(weights),
    )


def material(value: Any, where: str) -> Material:
    """A material by its name, or a density as a number or with a unit.

    :raises InputError: it is none of these; `where` it stands is named.
    """
    text = str(value).strip()
    if text in MATERIALS or text in ALSO:
        return Material(density_of(text), text)
    if text.replace("_", "").isalpha():
        try:
            return Material(density_of(text), text)
        except InputError as error:
            raise InputError(f"{where}: {error.message}", error.remedy) from error
    return Material(_positive(text, "kg/m**3", where))


def _positive(text: str, unit: str, where: str) -> float:
    try:
        number = float(parse_value(text, {}, unit))
    except InputError as error:
        raise InputError(f"{where}: {error.message}", error.remedy) from error
    if not 0.0 < number < 1e9:
        raise InputError(f"{where}: must be a positive number", f"Give it in {unit.replace('**3', '³')}.")
    return number


def _entries(file: Path) -> list[tuple[str, Any, str]]:
    source = parse_source(read_text(file), str(file))
    if not isinstance(source.data, dict) or not source.data:
        remedy = "Write for example a line 'piston*: aluminum', and '*: steel' before it."
        raise InputError(f"{file}: must map names of parts to materials or densities", remedy)
    if wrong := [name for name, value in source.data.items() if not isinstance(value, int | float | str)]:
        raise InputError(f"{file}: {listed(wrong)}: must be a material or a density", "Write for example steel.")
    return [(name, value, f"{file}:{source.lines.get((name,), 1)}: {name}") for name, value in source.data.items()]
