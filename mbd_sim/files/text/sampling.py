"""The rates and delays of sensors of other formats as those of a mechanism file, which are whole numbers of steps."""

from __future__ import annotations

STEP = 1e-3  # s, that of a mechanism file that does not say otherwise
ROUND_OFF = 1e-9


def sampling_keys(period: float, delay: float) -> tuple[dict[str, float], list[str]]:
    """The keys of a sensor, and what is otherwise than in the file.

    :param period: in s, 0 for each step; the same for `delay`.
    """
    keys: dict[str, float] = {}
    changed = []
    if period > 0.0:
        steps = max(1, round(period / STEP))
        keys["rate"] = 1.0 / (steps * STEP)
        if abs(steps * STEP - period) > ROUND_OFF * period:
            changed.append(
                f"rates that are not a whole number of steps of {STEP:g} s, of which the nearest one is taken"
            )
    if delay > 0.0:
        steps = round(delay / STEP)
        keys["delay"] = steps * STEP
        if abs(steps * STEP - delay) > ROUND_OFF * delay:
            changed.append(
                f"delays that are not a whole number of steps of {STEP:g} s, of which the nearest one is taken"
            )
    return keys, changed
