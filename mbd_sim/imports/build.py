"""An assembly with its masses and the joints that are offered, from which the files of a mechanism are written."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mbd_sim.base.geometry.pose import Array
from mbd_sim.imports.assembly import CadAssembly
from mbd_sim.imports.choice import Choice
from mbd_sim.imports.joints import Candidate
from mbd_sim.imports.masses import MassTable
from mbd_sim.imports.picture import write_picture
from mbd_sim.imports.written import UP, mesh_folder, write_stl, written


@dataclass(frozen=True, eq=False)
class Import:
    """What is imported, and `out`, the mechanism file. The axis `up` of the assembly, as z or -y, points upward."""

    assembly: CadAssembly
    table: MassTable
    candidates: tuple[Candidate, ...]
    out: Path
    up: str

    @property
    def upward(self) -> Array:
        """The unit vector (3,) that points upward, in the frame of the assembly."""
        axis, sign = UP[self.up]
        return np.asarray(sign * np.eye(3)[axis])

    @property
    def folder(self) -> Path:
        """Where the meshes go."""
        return mesh_folder(self.out)

    @property
    def picture(self) -> Path:
        """Where the picture with the numbers of the joints goes."""
        return self.out.with_name(f"{self.out.stem}_joints.png")

    def write(self, choice: Choice) -> int:
        """Write the mechanism file with the chosen joints, and the meshes; returns how many these are.

        :raises InputError: the mass of a part is not known.
        """
        found = written(self.assembly, self.table, self.candidates, choice, self.out, self.up)
        (self.folder if found.meshes else self.out.parent).mkdir(parents=True, exist_ok=True)
        for name, triangles in found.meshes.items():
            write_stl(self.folder / f"{name}.stl", triangles)
        self.out.write_text(found.text, encoding="utf-8")
        return len(found.meshes)

    def draw(self, choice: Choice) -> None:
        """Write the picture, in which the part that the user made ground is transparent."""
        glass = [] if choice.is_free else choice.held[:1]
        write_picture(self.picture, self.assembly, self.candidates, glass, self.upward)
