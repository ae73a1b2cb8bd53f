"""Densities of materials by name, in kg/m³: typical values of common grades at room temperature.

Sources: the tables of densities in engineering handbooks (Dubbel; Machinery's Handbook), rounded; plastics by data
sheets. The density of a given alloy, wood, foam or printed part differs: give it as a number.
"""

from __future__ import annotations

from collections.abc import Mapping

from mbd_sim.base.errors import InputError, nearest, quoted

MATERIALS: dict[str, float] = {
    "steel": 7850.0,
    "stainless_steel": 7900.0,
    "cast_iron": 7200.0,
    "aluminum": 2700.0,
    "magnesium": 1800.0,
    "titanium": 4430.0,  # Ti-6Al-4V
    "brass": 8500.0,
    "bronze": 8800.0,
    "copper": 8960.0,
    "zinc": 7140.0,
    "lead": 11340.0,
    "tungsten": 19300.0,
    "gold": 19300.0,
    "silver": 10490.0,
    "glass": 2500.0,
    "concrete": 2400.0,
    "oak": 700.0,
    "pine": 500.0,
    "plywood": 600.0,
    "carbon_fiber": 1600.0,  # laminate with epoxy
    "abs": 1050.0,
    "pla": 1240.0,
    "petg": 1270.0,
    "nylon": 1140.0,
    "pom": 1410.0,
    "peek": 1300.0,
    "pmma": 1190.0,
    "polycarbonate": 1200.0,
    "polyethylene": 950.0,
    "polypropylene": 910.0,
    "ptfe": 2200.0,
    "pvc": 1400.0,
    "rubber": 1100.0,
    "water": 1000.0,
}
ALSO = {"aluminium": "aluminum", "delrin": "pom", "acrylic": "pmma", "teflon": "ptfe", "polyamide": "nylon"}


def density_of(material: str, further: Mapping[str, float] | None = None) -> float:
    """The density in kg/m³ of a material.

    :param further: materials that count before those of the table.
    :raises InputError: it is in neither.
    """
    own = further or {}
    found = own.get(material, MATERIALS.get(ALSO.get(material, material)))
    if found is None:
        remedy = nearest(material, [*own, *MATERIALS, *ALSO])
        raise InputError(f"unknown material {quoted(material)}", f"{remedy} Or give a density in kg/m³.".strip())
    return found
