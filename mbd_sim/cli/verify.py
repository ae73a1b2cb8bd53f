"""`mbd_sim verify`: whether recorded runs are what the computation gives."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from mbd_sim.cli.common import MCAP_OR_BAG, ProgressBar, add_quiet, add_recordings, positive_number
from mbd_sim.errors import listed

if TYPE_CHECKING:
    from mbd_sim.recording.verification import Difference, Verification

HELP = "recompute recorded runs and compare them bit for bit"
DESCRIPTION = (
    "Recompute recorded runs from the mechanism, initial state and commands that they contain, and compare every "
    "recorded state. The exit code is 1 if any differs."
)

NOUNS = {
    "joint_states": "joint states", "energies": "energies", "constraint_violation": "constraint violations",
    "applied_efforts": "efforts", "applied_wrenches": "wrenches", "live_values": "live values", "resets": "resets",
}  # fmt: skip


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    add_recordings(parser, MCAP_OR_BAG)
    parser.add_argument(
        "--tolerance",
        type=positive_number,
        metavar="X",
        help="accept deviations up to X * (1 + |value|), comparing one recorded state to the next (default: bit for "
        "bit; 1e-9 for recordings from another machine or version)",
    )
    add_quiet(parser)


def execute(options: argparse.Namespace) -> int:
    """Verify all recordings and print a report on each; returns 1 if any recorded state differs."""
    from mbd_sim.recording.verification import verify

    all_hold = True
    for path in options.recordings:
        with ProgressBar(f"verify {path.name}", options.quiet) as progress:
            verifications = verify(path, options.tolerance, progress.show)
        for verification in verifications:
            print(verify_text(verification))
            all_hold &= verification.holds
    return 0 if all_hold else 1


def verify_text(found: Verification) -> str:
    """What a comparison gave, in a few lines."""
    how = "bit for bit" if found.tolerance is None else f"to {found.tolerance:g}"
    simulated = found.steps * found.step
    lines = [f"{found.path}: {_verdict(found, how)}"]
    lines += [f"  recorded with    {text}" for text in found.elsewhere]
    if found.elsewhere:
        lines.append("                   bits may differ there; each recorded state is compared with what follows from")
        lines.append("                   the one before")
    lines.append(f"  mechanism        {found.mechanism} ({found.method}, {found.step * 1e3:g} ms)")
    lines.append(f"  compared         {_counted(found.compared)}; under {_counted(found.commands) or 'no commands'}")
    lines.append(
        f"  computed         {found.steps} steps, {simulated:.6g} s simulated in {found.took:.3g} s: "
        f"{simulated / max(found.took, 1e-9):,.0f} × real time"
    )
    if found.problem:
        lines.append(f"  file             {found.problem}; compared is what it holds")
    if found.failure:
        lines.append(f"  NOT TO ITS END   {found.failure}")
    if found.first is not None:
        lines += _differences(found, found.first)
    return "\n".join(lines)


def _verdict(found: Verification, how: str) -> str:
    if found.first is not None:
        return f"DIFFERS from step {found.first.tick} on (t = {found.first.time:.9g} s)"
    if found.failure:
        return f"agrees {how} as far as it can be read"
    if not found.compared:
        return "holds no state to compare"
    return f"verified, {how}"


def _counted(counts: dict[str, int]) -> str:
    return ", ".join(f"{count} {NOUNS.get(role, role)}" for role, count in counts.items())


def _differences(found: Verification, first: Difference) -> list[str]:
    lines = [f"  first            {_told(first)}"]
    if found.largest is not None and found.largest is not first:
        lines.append(f"  largest          {_told(found.largest)}")
    lines.append(f"  differ           {found.differing} of {sum(found.compared.values())} messages")
    if found.differing == 1 and found.since:
        lines.append(
            f"  perhaps          what is recorded there is damaged: the {found.since} messages behind it agree"
        )
    elif found.suspects:
        lines.append(f"  perhaps          a command before it: {listed(found.suspects[::-1], 4)}")
    else:
        lines.append("  perhaps          what was recorded before: no command came since the last state that agrees")
    return lines


def _told(difference: Difference) -> str:
    recorded, computed = difference.recorded, difference.computed
    return (
        f"{difference.topic}, {difference.name}, step {difference.tick}, t = {difference.time:.9g} s: "
        f"recorded {recorded!r} ({recorded.hex()}), computed {computed!r} ({computed.hex()})"
    )
