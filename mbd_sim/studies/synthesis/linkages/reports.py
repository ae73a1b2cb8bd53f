"""Synthesized linkages as text for people: lengths in m, angles in degrees."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mbd_sim.base.errors import counted
from mbd_sim.studies.synthesis.linkages.dead_centers import DeadCenterFamily, DeadCenterFourBar
from mbd_sim.studies.synthesis.linkages.dyads import Dyad
from mbd_sim.studies.synthesis.linkages.functions import FunctionFourBar
from mbd_sim.studies.synthesis.linkages.poses import PoseSolutions

HEAD = 20  # width of the first column
MOST_DYADS = 12  # that are listed


def poses_text(found: PoseSolutions, most: int) -> str:
    """Poles, dyads, and a row for each linkage."""
    poles = [f"P{one}{other} ({_plain(pole)})" for (one, other), pole in found.poles.items()]
    lines = [f"{'Poles':<{HEAD}}{', '.join(poles) or 'none: all displacements are translations'}"]
    sliders = sum(dyad.kind != "RR" for dyad in found.dyads)
    links = counted(len(found.dyads) - sliders, "link")
    lines.append(f"{'Dyads':<{HEAD}}{links}, {counted(sliders, 'slider')}")
    if len(found.dyads) <= MOST_DYADS:
        lines += [f"  {_dyad(dyad, found)}" for dyad in found.dyads]
    good = sum(not one.defects for one in found.linkages)
    lines.append(
        f"{'Linkages':<{HEAD}}{len(found.linkages)} of {counted(found.tried, 'pair')}, {good} without defects"
        f"{f', the best {most}' if len(found.linkages) > most else ''}:"
    )
    for number, one in enumerate(found.linkages[:most], 1):
        angle = f"{np.degrees(one.transmission):.4g} deg"
        lines.append(f"  {number:>2}  {one.kind:<22}{angle:>11}  {_ends(one.driver)}; {_ends(one.follower)}"
                     f"{f'; {one.defects}' if one.defects else ''}")  # fmt: skip
    if found.linkages:
        lines.append(
            "The angle is the least transmission angle between the first and the last pose; the driven link is first."
        )
    return "\n".join(lines)


def _dyad(dyad: Dyad, found: PoseSolutions) -> str:
    first = found.poses[0]
    body = (dyad.point - first.origin) / first.turn
    match dyad.kind:
        case "RR":
            ends = f"center ({_plain(dyad.center)}), point of the body ({_plain(body)})"
            return f"link    {ends}, length {dyad.length:.6g} m"
        case "PR":
            return f"guide   at {np.degrees(np.angle(dyad.direction)):.6g} deg, point of the body ({_plain(body)})"
        case _:
            angle = np.degrees(np.angle(dyad.direction / first.turn))
            return f"block   pivot ({_plain(dyad.center)}), line of the body at {angle:.6g} deg"


def _ends(dyad: Dyad) -> str:
    match dyad.kind:
        case "RR":
            return f"({_plain(dyad.center)}) to ({_plain(dyad.point)})"
        case "PR":
            return f"guide at {np.degrees(np.angle(dyad.direction)):.5g} deg through ({_plain(dyad.point)})"
        case _:
            return f"block at ({_plain(dyad.center)})"


def dead_center_text(found: DeadCenterFamily) -> str:
    """The best linkage of a family."""
    best = found.best
    lengths = {"crank": best.crank, "coupler": best.coupler}
    if isinstance(best, DeadCenterFourBar):
        lengths |= {"rocker": best.rocker, "base": best.base}
    else:
        lengths |= {"offset": best.offset}
    lines = [f"{name:<{HEAD}}{value:.8g} m" for name, value in lengths.items()]
    lines.append(f"{'Transmission angle':<{HEAD}}{np.degrees(best.transmission):.5g} deg, the least of a turn")
    worst = min(one.transmission for one in found.family)
    chosen = f"the best of a family with {np.degrees(worst):.3g} to {np.degrees(best.transmission):.3g} deg"
    lines.append(f"{'Choice':<{HEAD}}{chosen}")
    return "\n".join(lines)


def functions_text(found: Sequence[FunctionFourBar], most: int) -> str:
    """A row for each four-bar on a base of 1 m."""
    if not found:
        return "There is no four-bar for these positions. Choose other starts, travels or positions."
    lines = [f"{'Four-bars':<{HEAD}}{len(found)}, on a base of 1 m:"]
    for number, one in enumerate(found[:most], 1):
        error = np.degrees(np.max(np.abs(one.deviations)))
        lines.append(
            f"  {number:>2}  crank {one.crank:.6g} m, coupler {one.coupler:.6g} m, follower {one.follower:.6g} m; "
            f"start {np.degrees(one.theta[0]):.6g} deg, {np.degrees(one.phi[0]):.6g} deg; transmission angle "
            f"{np.degrees(one.transmission):.4g} deg; largest deviation {error:.2g} deg"
            f"{f'; {one.defects}' if one.defects else ''}"
        )
    return "\n".join(lines)


def _plain(point: complex) -> str:
    return f"{point.real + 0.0:.5g}, {point.imag + 0.0:.5g}"
