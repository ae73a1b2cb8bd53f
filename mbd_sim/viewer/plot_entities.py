"""The lines in the plots: joints, the energy account, and what is left of it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import rerun as rr

from mbd_sim.appearance import palette
from mbd_sim.appearance.palette import Color
from mbd_sim.appearance.residual_scale import residual_size
from mbd_sim.geometry.pose import Array
from mbd_sim.viewer import entity_paths
from mbd_sim.viewer.entity import Logged, Prop
from mbd_sim.viewer.joint_coordinates import coordinates
from mbd_sim.viewer.placement import Placement
from mbd_sim.viewer.sample_rows import Rows
from mbd_sim.viewer.scene_description import Stage

WIDTH = 1.6


@dataclass(frozen=True)
class Series:
    """Lines of one plot: their entity, names and colours."""

    entity: str
    names: tuple[str, ...]
    colors: tuple[Color, ...]
    stepped: bool = False

    def style(self) -> Logged:
        """What does not change."""
        mode = rr.components.InterpolationMode.StepAfter if self.stepped else None
        count = len(self.names)
        style = rr.SeriesLines(
            names=list(self.names), colors=list(self.colors), widths=[WIDTH] * count, interpolation_mode=mode
        )
        yield self.entity, style

    def values(self, values: Array) -> Logged:
        """A row (k,) for each sample, (n, k)."""
        yield self.entity, scalars(values)


def scalars(values: Array) -> Any:
    """Columns of several numbers a row, (n, k)."""
    return rr.Scalars.columns(scalars=np.ascontiguousarray(values).ravel()).partition([values.shape[1]] * len(values))


def plots(stage: Stage) -> Iterator[Prop]:
    """All of them."""
    if stage.mechanism.coordinate_names or stage.mechanism.driven_names:
        yield _Joints(stage)
    yield _Energies(bool(stage.mechanism.driven_names))
    if stage.look.reactions:
        yield _Reactions(stage)


class _Joints:
    """Positions, velocities and efforts, angles apart from displacements; the driven coordinates come last."""

    def __init__(self, stage: Stage) -> None:
        self._stage = stage
        mechanism = stage.mechanism
        kinds = [*entity_paths.free_kinds(mechanism), *entity_paths.driven_kinds(mechanism)]
        names = [*mechanism.coordinate_names, *mechanism.driven_names]
        colors = [*palette.series_colors(mechanism), *[palette.DRIVEN] * len(mechanism.driven_names)]
        self._series: list[tuple[int, list[int], Series]] = []
        for kind in (entity_paths.ANGULAR, entity_paths.LINEAR):
            own = [index for index, other in enumerate(kinds) if other == kind]
            for row, entity in enumerate((entity_paths.POSITION, entity_paths.VELOCITY, entity_paths.EFFORT)):
                series = Series(
                    f"{entity}/{kind}",
                    tuple(names[index] for index in own),
                    tuple(colors[index] for index in own),
                    stepped=entity == entity_paths.EFFORT and not mechanism.driven_names,
                )
                if own:
                    self._series.append((row, own, series))

    def static(self) -> Logged:
        for _, _, series in self._series:
            yield from series.style()

    def columns(self, rows: Rows, placement: Placement) -> Logged:
        stage = self._stage
        speeds = rows.of("y")[:, stage.nq : stage.nq + stage.nv]
        free = (coordinates(stage, rows), speeds, rows.of("inputs")[:, : stage.nv])
        driven = np.split(rows.of("drives"), 3, axis=1)
        values = [np.hstack(pair) for pair in zip(free, driven, strict=True)]
        for row, own, series in self._series:
            yield from series.values(values[row][:, own])


STACK = Series(
    entity_paths.STACK,
    ("potential", "+ kinetic", "+ dissipated", "\N{MINUS SIGN} work: stays at the start's energy"),
    (palette.POTENTIAL, palette.KINETIC, palette.DISSIPATED, palette.TOTAL),
)
RESIDUAL = Series(
    entity_paths.RESIDUAL, ("log\N{SUBSCRIPT ONE}\N{SUBSCRIPT ZERO} |residual / J|",), (palette.RESIDUAL,)
)
RESIDUAL_PJ = Series(entity_paths.RESIDUAL_PJ, ("residual",), (palette.RESIDUAL,))


class _Energies:
    """The account names the work of drives only where there are any."""

    def __init__(self, driven: bool) -> None:
        lines = [("kinetic", palette.KINETIC), ("potential", palette.POTENTIAL), ("total", palette.TOTAL)]
        lines += [("dissipated", palette.DISSIPATED), ("work of forces", palette.WORK_APPLIED)]
        lines += [("work of drives", palette.WORK_DRIVES)] if driven else []
        names, colors = zip(*lines, strict=True)
        self._account = Series(entity_paths.ACCOUNT, names, colors)

    def static(self) -> Logged:
        for series in (self._account, STACK, RESIDUAL, RESIDUAL_PJ):
            yield from series.style()

    def columns(self, rows: Rows, placement: Placement) -> Logged:
        kinetic, potential, dissipated, applied, drives, total, residual = rows.of("audit").T
        account = np.column_stack([kinetic, potential, total, dissipated, applied, drives])
        yield from self._account.values(account[:, : len(self._account.names)])
        spent = total + dissipated
        yield from STACK.values(np.column_stack([potential, total, spent, spent - applied - drives]))
        yield from RESIDUAL.values(np.log10(residual_size(rows.of("audit")))[:, None])
        yield from RESIDUAL_PJ.values(residual[:, None] / entity_paths.PICO)


class _Reactions:
    """How large the forces through the joints are."""

    def __init__(self, stage: Stage) -> None:
        names = tuple(stage.mechanism.all_joints)
        colors = [palette.PARTS[index % len(palette.PARTS)] for index in range(len(names))]
        self._series = Series(entity_paths.REACTION, names, tuple(colors))

    def static(self) -> Logged:
        yield from self._series.style()

    def columns(self, rows: Rows, placement: Placement) -> Logged:
        forces = rows.of("reactions").reshape(len(rows), -1, 6)[:, :, :3]
        yield from self._series.values(np.linalg.norm(forces, axis=2))


def units(entities: Sequence[str]) -> str:
    """Of entities of joints, as a list."""
    return ", ".join(entity_paths.UNITS[entity] for entity in entities)
