"""Where two outlines in one plane meet: the narrow phase of pairs of chains of lines, arcs and involutes.

Only pieces that face each other can touch. A pair of pieces that penetrate each other counts if the points of both are
inside the other outline, and no pair beside it has less depth: the far side of a thin tip is not a place of contact.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from mbd_sim.compiler.ir.python_kinds import Array, Integers, integers, zeros
from mbd_sim.dynamics.contact.feature_rows import KEY, SLOT_SIZE
from mbd_sim.simulation.contact.compiled.features.pieces import (
    AT,
    GAP,
    MARGIN,
    MEETING,
    NORMAL,
    OTHER,
    SURE,
    Pieces,
    depth_of,
    length_of,
    lower_bound,
    meet_pieces,
    turned_x,
    turned_y,
)
from mbd_sim.simulation.contact.compiled.features.vectors import dot, place, subtract, turn

REACH = 0.05  # of the size of the smaller outline, distance up to which pieces are looked at one by one
DEEP = 0.3  # of that size, depth up to which pieces of outlines that touch nowhere can penetrate each other
NEIGHBORS = 8.0  # times what a pair is beyond its ends, and its depth: at most so far are the points of its neighbors
BORDER = 0.5  # of the tolerance, by which a point may be beyond the end of its piece
SAME = 8.0  # tolerances, up to which two points are one
PARALLEL = 1e-6  # sine of the angle up to which two normals are one
SURFACE = 1e-14  # of the size, depth up to which a point is on the outline
FIRST, SECOND, MARK = 8, 9, 10  # behind a meeting: the indices of both pieces, and what is decided of it
FOUND = 11
OPEN, CANDIDATE, KEPT = 0, 1, 2  # marks


@dataclass(frozen=True)
class Outlines:
    """Two outlines, and a `point` as an outline.

    `frame` and `other_frame` (9,) are the origins and both axes of their planes in the frames of the parts. The smaller
    one has the size `scale`. A roller, which `is_roller`, can be inside another outline in a single step.
    """

    first: Pieces
    second: Pieces
    point: Pieces
    frame: Array
    other_frame: Array
    scale: float
    is_roller: bool
    slots: int


def put(p: Outlines, one: Array, other: Array, out: Array) -> None:
    """The place of the plane of the first body in that of the second one."""
    axis, other_axis, other_side, at, base = zeros(3), zeros(3), zeros(3), zeros(3), zeros(3)
    turn(one, p.frame[3:], axis)
    turn(other, p.other_frame[3:], other_axis)
    turn(other, p.other_frame[6:], other_side)
    place(one, p.frame, at)
    place(other, p.other_frame, base)
    subtract(at, base, at)
    out[0], out[1] = dot(axis, other_axis), dot(axis, other_side)
    out[2], out[3] = dot(other_axis, at), dot(other_side, at)


def back_x(at: Array, x: float, y: float) -> float:
    """The first coordinate, in the plane of the first body, of a point in that of the second one."""
    return at[0] * (x - at[2]) + at[1] * (y - at[3])


def back_y(at: Array, x: float, y: float) -> float:
    """The second coordinate of it."""
    return at[0] * (y - at[3]) - at[1] * (x - at[2])


def find_near_pieces(p: Outlines, at: Array, reach: float, firsts: Integers, seconds: Integers) -> float:
    """Mark the pieces that may be near the other outline; a distance below which no other one is."""
    one, other, beyond = p.first, p.second, math.inf
    for i in range(one.count):
        x = turned_x(at, one.middles[2 * i :]) + at[2] - other.center[0]
        y = turned_y(at, one.middles[2 * i :]) + at[3] - other.center[1]
        apart = length_of(x, y) - one.spreads[i] - other.radius
        firsts[i] = apart <= reach
        beyond = beyond if firsts[i] else min(beyond, apart)
    center_x, center_y = turned_x(at, one.center) + at[2], turned_y(at, one.center) + at[3]
    for j in range(other.count):
        apart = length_of(other.middles[2 * j] - center_x, other.middles[2 * j + 1] - center_y)
        apart = apart - other.spreads[j] - one.radius
        seconds[j] = apart <= reach
        beyond = beyond if seconds[j] else min(beyond, apart)
    return beyond


def count_near(p: Outlines, at: Array, reach: float, firsts: Integers, seconds: Integers, beyond: Array) -> int:
    """The number of pairs of these pieces that are near each other; `beyond[0]` falls to a distance of the others."""
    count = 0
    for i in range(p.first.count):
        if firsts[i]:
            for j in range(p.second.count):
                if seconds[j]:
                    bound = lower_bound(p.first, p.second, at, i, j)
                    if bound <= reach:
                        count += 1
                    else:
                        beyond[0] = min(beyond[0], bound)
    return count


def find_pairs(p: Outlines, at: Array, reach: float, firsts: Integers, seconds: Integers, found: Array) -> None:
    """The meetings of the pairs that `count_near` counts."""
    count = 0
    for i in range(p.first.count):
        if firsts[i]:
            for j in range(p.second.count):
                if seconds[j] and lower_bound(p.first, p.second, at, i, j) <= reach:
                    row = found[FOUND * count :]
                    meet_pieces(p.first, p.second, at, i, j, row)
                    row[FIRST], row[SECOND], row[MARK] = i, j, OPEN
                    count += 1


def outline_distance(p: Outlines, one: Array, other: Array) -> float:
    """See `NarrowPhase`."""
    at = zeros(4)
    put(p, one, other, at)
    distance = distance_within(p, at, REACH * p.scale, True)
    if distance < 0.0 or (distance <= REACH * p.scale and not p.is_roller):
        return distance
    deeper = distance_within(p, at, DEEP * p.scale, False)
    if deeper < 0.0:
        return deeper
    return -distance if is_within(p, at) else distance


def distance_within(p: Outlines, at: Array, reach: float, with_others: bool) -> float:
    """The least gap of pairs within reach, negative if any of them penetrate each other; or that of others."""
    firsts, seconds, beyond = integers(p.first.count), integers(p.second.count), zeros(1)
    beyond[0] = find_near_pieces(p, at, reach, firsts, seconds)
    count = count_near(p, at, reach, firsts, seconds, beyond)
    found = zeros(FOUND * count)
    find_pairs(p, at, reach, firsts, seconds, found)
    least = least_gap(p, found, count, at, reach)
    return min(least, beyond[0]) if with_others else least


def least_gap(p: Outlines, found: Array, count: int, at: Array, reach: float) -> float:
    """The least gap in m of some pairs, negative if any of them penetrate each other; infinite without any.

    The points of a pair with a negative gap are so far from each other, and so near are the outlines: without another
    pair that is apart by less, they overlap, even if neither point is inside, as where two sharp corners cross.

    :param reach: all pairs that are nearer are among these.
    """
    apart, deepest, least, sure = math.inf, math.inf, math.inf, SURE * p.scale
    for k in range(count):
        row = found[FOUND * k :]
        if row[MARGIN] >= 0.0 or (row[MARGIN] >= -sure and not is_passed(found, count, k, sure)):
            if row[GAP] < 0.0:
                row[MARK] = CANDIDATE
                least = min(least, -row[GAP])
            else:
                apart = min(apart, row[GAP])
    keep_penetrating(p, found, count, at)
    for k in range(count):
        if found[FOUND * k + MARK] == KEPT:
            deepest = min(deepest, found[FOUND * k + GAP])
    if deepest < math.inf:
        return deepest
    return -least if least + 2.0 * sure < min(apart, reach) else apart


def is_passed(found: Array, count: int, k: int, sure: float) -> bool:
    """Whether a pair beyond the ends of its pieces has one at the same place that is not: it has taken over."""
    row = found[FOUND * k :]
    near = NEIGHBORS * (sure - min(row[GAP], 0.0))
    return any(
        found[FOUND * n + MARGIN] >= 0.0
        and length_of(row[AT] - found[FOUND * n + AT], row[AT + 1] - found[FOUND * n + AT + 1]) <= near
        and length_of(row[OTHER] - found[FOUND * n + OTHER], row[OTHER + 1] - found[FOUND * n + OTHER + 1]) <= near
        for n in range(count)
    )


def keep_penetrating(p: Outlines, found: Array, count: int, at: Array) -> None:
    """Keep candidates that penetrate each other where they face each other, without one of less depth beside them."""
    for _ in range(count):
        best = -1
        for k in range(count):
            is_better = best < 0 or found[FOUND * k + GAP] > found[FOUND * best + GAP]
            if found[FOUND * k + MARK] == CANDIDATE and is_better:
                best = k
        if best < 0:
            return
        row = found[FOUND * best :]
        row[MARK] = OPEN
        is_kept = not any(found[FOUND * k + MARK] == KEPT and is_beside(row, found[FOUND * k :]) for k in range(count))
        if is_kept and is_inside(p, row, at):
            row[MARK] = KEPT


def is_beside(row: Array, known: Array) -> bool:
    """Whether a pair has a piece in common with a known one of less depth, at the same place."""
    if row[FIRST] != known[FIRST] and row[SECOND] != known[SECOND]:
        return False
    reach = abs(row[GAP]) + abs(known[GAP])
    apart = length_of(row[AT] - known[AT], row[AT + 1] - known[AT + 1])
    other = length_of(row[OTHER] - known[OTHER], row[OTHER + 1] - known[OTHER + 1])
    return min(apart, other) <= 2.0 * reach and max(apart, other) <= 4.0 * reach


def is_inside(p: Outlines, row: Array, at: Array) -> bool:
    """Whether the point of each piece is inside the other outline.

    If one is a corner, only its point need be; if one is thin, only that of the thin one. Beside a corner of the other
    outline, a corner can leave it on another side while both outlines go on to overlap: then the point that faces it,
    which is not its own, is inside the outline of the corner.
    """
    one, other, surface = p.first, p.second, SURFACE * p.scale
    first_corner, second_corner = one.corners[int(row[FIRST])], other.corners[int(row[SECOND])]
    own = not one.thin and (other.thin or not first_corner)
    its = not other.thin and (one.thin or not second_corner)
    x, y = back_x(at, row[OTHER], row[OTHER + 1]), back_y(at, row[OTHER], row[OTHER + 1])
    if its and depth_of(p.point, other, row[AT], row[AT + 1]) < -surface:
        return not own and not one.thin and depth_of(p.point, one, x, y) > surface
    if own and depth_of(p.point, one, x, y) < -surface:
        return not its and not other.thin and depth_of(p.point, other, row[AT], row[AT + 1]) > surface
    return True


def is_within(p: Outlines, at: Array) -> bool:
    """Whether one of two outlines that do not cross each other is inside the other one."""
    one, other = p.first, p.second
    x, y = turned_x(at, one.sample) + at[2], turned_y(at, one.sample) + at[3]
    if length_of(x - other.center[0], y - other.center[1]) < other.radius and depth_of(p.point, other, x, y) > 0.0:
        return True
    x, y = back_x(at, other.sample[0], other.sample[1]), back_y(at, other.sample[0], other.sample[1])
    return length_of(x - one.center[0], y - one.center[1]) < one.radius and depth_of(p.point, one, x, y) > 0.0


def outline_touching(p: Outlines, one: Array, other: Array, tolerance: float, slots: Array) -> int:
    """See `NarrowPhase`; the number of points, which can be more than there are slots."""
    at, firsts, seconds, beyond = zeros(4), integers(p.first.count), integers(p.second.count), zeros(1)
    put(p, one, other, at)
    find_near_pieces(p, at, REACH * p.scale, firsts, seconds)
    count = count_near(p, at, REACH * p.scale, firsts, seconds, beyond)
    found = zeros(FOUND * count)
    find_pairs(p, at, REACH * p.scale, firsts, seconds, found)
    for k in range(count):
        row = found[FOUND * k :]
        if row[MARGIN] >= -BORDER * tolerance and row[GAP] < -tolerance:
            row[MARK] = CANDIDATE
    keep_penetrating(p, found, count, at)
    has_sure = False
    for k in range(count):
        row = found[FOUND * k :]
        if row[MARGIN] >= -BORDER * tolerance and abs(row[GAP]) <= tolerance:
            row[MARK] = KEPT
        has_sure = has_sure or (row[MARK] == KEPT and not both_corners(p, row))
    chosen = 0
    for k in range(count):
        row = found[FOUND * k :]
        is_new = row[MARK] == KEPT and not (
            has_sure and both_corners(p, row)
        )  # two corners in one point have no normal
        if is_new and not any(is_same(row, found[FOUND * n :], tolerance) for n in range(chosen)):
            if chosen < p.slots:
                write_slot(p, row, slots[SLOT_SIZE * chosen :])
            for n in range(FOUND):
                found[FOUND * chosen + n] = row[n]
            chosen += 1
    return chosen


def both_corners(p: Outlines, row: Array) -> bool:
    """Whether both pieces are corners."""
    return p.first.corners[int(row[FIRST])] != 0 and p.second.corners[int(row[SECOND])] != 0


def is_same(row: Array, known: Array, tolerance: float) -> bool:
    """Whether two pairs touch in the same point and direction."""
    if length_of(row[AT] - known[AT], row[AT + 1] - known[AT + 1]) > SAME * tolerance:
        return False
    ax, ay, bx, by = row[NORMAL], row[NORMAL + 1], known[NORMAL], known[NORMAL + 1]
    return ax * bx + ay * by > 0.0 and abs(ax * by - ay * bx) <= PARALLEL


def outline_margin(p: Outlines, one: Array, other: Array, numbers: Array, spot: Array) -> float:
    """See `NarrowPhase`, and `SPOT` in `pairs`."""
    at, meeting, reach = zeros(4), zeros(MEETING), REACH * p.scale
    firsts, seconds = integers(p.first.count), integers(p.second.count)
    code = int(numbers[KEY]) - 1
    i, j = code // p.second.count, code % p.second.count
    put(p, one, other, at)
    find_near_pieces(p, at, reach, firsts, seconds)
    if not (firsts[i] and seconds[j]) or lower_bound(p.first, p.second, at, i, j) > reach:
        return -p.scale
    meet_pieces(p.first, p.second, at, i, j, meeting)
    for k in range(2):
        spot[k], spot[3 + k] = meeting[AT + k], meeting[NORMAL + k]
    spot[6] = meeting[GAP]
    return max(meeting[MARGIN], -p.scale)


def write_slot(p: Outlines, row: Array, slot: Array) -> None:
    """The numbers of a slot: see `mbd_sim.dynamics.contact.outline_rows`."""
    one, other, i, j = p.first, p.second, int(row[FIRST]), int(row[SECOND])
    for k in range(SLOT_SIZE):
        slot[k] = 0.0
    for k in range(2):
        slot[k], slot[2 + k] = one.centers[2 * i + k], other.centers[2 * j + k]
        slot[4 + k], slot[6 + k] = one.starts[2 * i + k], other.starts[2 * j + k]
    slot[8], slot[9], slot[10], slot[11] = one.radii[i], other.radii[j], one.growths[i], other.growths[j]
    slot[12], slot[13] = one.straight[i], other.straight[j]
    slot[14] = -1.0 if one.hollow[i] or other.hollow[j] else 1.0
    slot[KEY] = 1 + i * other.count + j
