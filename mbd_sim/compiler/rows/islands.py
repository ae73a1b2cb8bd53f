"""Islands of rows that no forces of other rows change, in the subset of Python that is compiled."""

from __future__ import annotations

from mbd_sim.compiler.ir.python_kinds import Array, Integers, integers

MANY = 100  # rows from which on islands, and what is not zero, are looked for: below, that takes longer than it saves


def find_islands(n: int, gaps: int, matrix: Array, closed: Array, active: Array, islands: Integers) -> int:
    """The number of the island (n,) of each row that is active or closed, -1 for others; how many islands there are.

    :param matrix: (n, n) column by column.
    :param closed: (gaps,) and `active` (n,) are not zero for these rows.
    """
    rows, count, found, numbers = integers(n), 0, 0, integers(n)
    for i in range(n):
        is_closed = closed[i] != 0.0 if i < gaps else False
        islands[i] = -1
        if is_closed or active[i] != 0.0:
            rows[count], islands[i] = i, i
            count += 1
    for j in range(count):
        for i in range(count):
            if matrix[rows[i] + rows[j] * n] != 0.0:
                unite(islands, count, rows, islands[rows[i]], islands[rows[j]])
    for i in range(count):
        if islands[rows[i]] == rows[i]:  # an island is named after its first row until now
            numbers[rows[i]] = found
            found += 1
    for i in range(count):
        islands[rows[i]] = numbers[islands[rows[i]]]
    return found


def unite(islands: Integers, count: int, rows: Integers, one: int, other: int) -> None:
    """Give the rows of two islands the lower one of their names."""
    lower, higher = min(one, other), max(one, other)
    for i in range(count if lower < higher else 0):
        if islands[rows[i]] == higher:
            islands[rows[i]] = lower
