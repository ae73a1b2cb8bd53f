"""Small linear systems and linear complementarity problems, in the subset of Python that is compiled.

Linear systems are solved by elimination with complete pivoting, and block by block where they consist of blocks that
have nothing to do with each other, as those of bodies that are apart. Complementarity problems are solved by Lemke's
method (Cottle, Pang & Stone, *The Linear Complementarity Problem*). Matrices are stored row by row.
"""

from __future__ import annotations

import math

from mbd_sim.compiler.ir.python_kinds import Array, Integers, integers, zeros
from mbd_sim.compiler.rows.islands import number_islands, unite

SINGULAR = 1e-11  # of the largest entry, below which a pivot counts as zero
ZERO_ENTRY = 1e-12  # relative size below which an entry of the tableau counts as zero


def product(m: int, n: int, k: int, matrix: Array, other: Array, total: Array) -> None:
    """The product (m, k) of a matrix (m, n) and another one (n, k), of which zeros are left out, summed in order."""
    for i in range(m * k):
        total[i] = 0.0
    for column in range(n):
        for j in range(k):
            factor = other[column * k + j]
            if factor != 0.0:
                for i in range(m):
                    total[i * k + j] += matrix[i * n + column] * factor


def triangular(m: int, n: int, k: int, a: Array, columns: Integers) -> int:
    """Reduce [matrix (m, n) | right (m, k)] to triangular form, in place; the order of the n columns, and the rank."""
    width, done, row, column, pivot, factor, size = n + k, 0, 0, 0, -1.0, 0.0, 0.0
    for j in range(n):
        columns[j] = j
    for i in range(m):
        for j in range(n):
            size = abs(a[i * width + j])
            if size > pivot or size != size:
                row, column, pivot = i, j, size
    largest = max(pivot, 0.0)
    while done < m and done < n and pivot > SINGULAR * largest:
        for j in range(width):
            a[done * width + j], a[row * width + j] = a[row * width + j], a[done * width + j]
        for i in range(m):
            a[i * width + done], a[i * width + column] = a[i * width + column], a[i * width + done]
        columns[done], columns[column] = columns[column], columns[done]
        pivot = -1.0
        base = a[done * width :]
        for i in range(done + 1, m):
            own = a[i * width :]
            factor = own[done] / base[done]
            if factor != 0.0:
                for j in range(done + 1, width):
                    own[j] -= factor * base[j]
            for j in range(done + 1, n):
                size = abs(own[j])
                if size > pivot:
                    row, column, pivot = i, j, size
        done += 1
    return done


def back_substitute(found: int, width: int, a: Array, x: Array) -> None:
    """Solve a triangular system of which x is the right side."""
    for index in range(found - 1, -1, -1):
        x[index] /= a[index * width + index]
        for i in range(index):
            x[i] -= a[i * width + index] * x[index]


def find_blocks(n: int, matrix: Array, blocks: Integers) -> int:
    """The number of the block (n,) of each row of a matrix, in the order of their first rows; how many there are.

    Rows of different blocks have no entries in the columns of each other.
    """
    for i in range(n):
        blocks[i] = i
    for i in range(n):
        for j in range(n):
            if matrix[i * n + j] != 0.0:
                unite(n, blocks, i, j)
    return number_islands(n, blocks)


def block_rows(n: int, blocks: Integers, block: int, rows: Integers) -> int:
    """The rows of a block, in order, and how many they are."""
    count = 0
    for i in range(n):
        if blocks[i] == block:
            rows[count] = i
            count += 1
    return count


def take_block(n: int, matrix: Array, count: int, rows: Integers, own: Array) -> None:
    """Write the entries of some rows and columns, so many, into a matrix of their own."""
    for i in range(count):
        for j in range(count):
            own[i * count + j] = matrix[rows[i] * n + rows[j]]


def solve(n: int, matrix: Array, right: Array, x: Array) -> None:
    """A solution x (n,) of a square system; unknowns of dependent columns are zero.

    Equations that depend on others are not checked.
    """
    a, columns, found = zeros(n * (n + 1)), integers(n), zeros(n)
    for i in range(n):
        for j in range(n):
            a[i * (n + 1) + j] = matrix[i * n + j]
        a[i * (n + 1) + n] = right[i]
    rank = triangular(n, n, 1, a, columns)
    for i in range(rank):
        found[i] = a[i * (n + 1) + n]
    back_substitute(rank, n + 1, a, found)
    for i in range(n):
        x[i] = 0.0
    for i in range(rank):
        x[columns[i]] = found[i]


def solve_regular(n: int, a: Array, x: Array) -> bool:
    """Solve a square system of which x is the right side, and `a` the matrix, which changes; False if it is singular.

    With row exchanges alone, in less than half of the time of `solve`.
    """
    largest = 0.0
    for i in range(n * n):
        largest = max(largest, abs(a[i]))
    for done in range(n):
        row = done
        for i in range(done + 1, n):
            row = i if abs(a[i * n + done]) > abs(a[row * n + done]) else row
        if not abs(a[row * n + done]) > SINGULAR * largest:
            return False
        for j in range(done, n):
            a[done * n + j], a[row * n + j] = a[row * n + j], a[done * n + j]
        x[done], x[row] = x[row], x[done]
        base = a[done * n :]
        for i in range(done + 1, n):
            own = a[i * n :]
            factor = own[done] / base[done]
            if factor != 0.0:
                for j in range(done + 1, n):
                    own[j] -= factor * base[j]
                x[i] -= factor * x[done]
    back_substitute(n, n, a, x)
    return True


def null_space(m: int, n: int, matrix: Array, basis: Array) -> int:
    """Independent solutions, the rows of `basis` (n, n), of A x = 0; their number."""
    a, columns, found = zeros(m * n), integers(n), zeros(n)
    for i in range(m * n):
        a[i] = matrix[i]
    rank = triangular(m, n, 0, a, columns)
    for index in range(n - rank):
        for i in range(n):
            basis[index * n + i] = 0.0
        for i in range(rank):
            found[i] = a[i * n + rank + index]
        back_substitute(rank, n, a, found)
        for i in range(rank):
            basis[index * n + columns[i]] = -found[i]
        basis[index * n + columns[rank + index]] = 1.0
    return n - rank


def least(n: int, count: int, basis: Array, weights: Array, x: Array) -> None:
    """Add to x (n,) a combination of the rows of `basis` (count, n), so that Σ w x² is least."""
    if count == 0:
        return
    normal, right, factors = zeros(count * count), zeros(count), zeros(count)
    for i in range(count):
        for k in range(n):
            weighted = basis[i * n + k] * weights[k]
            for j in range(count):
                normal[i * count + j] += weighted * basis[j * n + k]
            right[i] += weighted * x[k]
    solve(count, normal, right, factors)
    for k in range(n):
        change = 0.0
        for i in range(count):
            change += basis[i * n + k] * factors[i]
        x[k] -= change


def least_solution(n: int, matrix: Array, right: Array, weights: Array, x: Array) -> None:
    """The solution x (n,) of a square system; of several that with the least Σ w x². Blocks are solved one by one."""
    blocks = integers(n)
    count = find_blocks(n, matrix, blocks)
    for block in range(count):
        least_solution_of(n, matrix, right, weights, x, blocks, block)


def least_solution_of(
    n: int, matrix: Array, right: Array, weights: Array, x: Array, blocks: Integers, block: int
) -> None:
    """The `least_solution` of one block."""
    rows = integers(n)
    size = block_rows(n, blocks, block, rows)
    own, basis, side, found, weight = zeros(size * size), zeros(size * size), zeros(size), zeros(size), zeros(size)
    take_block(n, matrix, size, rows, own)
    for i in range(size):
        side[i], weight[i] = right[rows[i]], weights[rows[i]]
    solve(size, own, side, found)
    least(size, null_space(size, size, own, basis), basis, weight, found)
    for i in range(size):
        x[rows[i]] = found[i]


def pivots(n: int, matrix: Array, columns: Integers) -> int:
    """Columns of a square matrix that are independent, as many as there are; of each block in the order of pivots."""
    blocks, rank = integers(n), 0
    count = find_blocks(n, matrix, blocks)
    for block in range(count):
        rank += pivots_of(n, matrix, blocks, block, columns[rank:])
    return rank


def pivots_of(n: int, matrix: Array, blocks: Integers, block: int, columns: Integers) -> int:
    """The `pivots` of one block."""
    rows = integers(n)
    size = block_rows(n, blocks, block, rows)
    own, order = zeros(size * size), integers(size)
    take_block(n, matrix, size, rows, own)
    rank = triangular(size, size, 0, own, order)
    for i in range(rank):
        columns[i] = rows[order[i]]
    return rank


def rank_of(n: int, matrix: Array) -> int:
    """How many columns of a square matrix are independent."""
    order = integers(n)
    return pivots(n, matrix, order)


def unit_diagonal(n: int, matrix: Array, factors: Array) -> None:
    """Scale a symmetric positive semidefinite matrix to a diagonal of ones, in place, by factors (n,) of its rows."""
    for i in range(n):
        diagonal = matrix[i * n + i]
        factors[i] = 1.0 / math.sqrt(diagonal if diagonal > 0.0 else 1.0)
    for i in range(n):
        for j in range(n):
            matrix[i * n + j] = matrix[i * n + j] * factors[i] * factors[j]


def best_conditioned(n: int, matrix: Array, count: int, rows: Integers, found: Integers) -> int:
    """Those of some rows of a symmetric positive semidefinite matrix that are independent, by their pivots."""
    if count < 2:
        if count and matrix[rows[0] * n + rows[0]] > 0.0:
            found[0] = rows[0]
            return 1
        return 0
    own, factors, order = zeros(count * count), zeros(count), integers(count)
    take_block(n, matrix, count, rows, own)
    unit_diagonal(count, own, factors)
    rank = pivots(count, own, order)
    for i in range(rank):
        found[i] = rows[order[i]]
    return rank


def independent(n: int, matrix: Array, count: int, order: Integers, found: Integers) -> int:
    """Those rows of a symmetric positive semidefinite matrix (n, n), taken in an order, that are independent."""
    a, column, entries, chosen = zeros(count * count), zeros(count), zeros(count), 0
    take_block(n, matrix, count, order, a)
    for position in range(count):
        row = order[position]
        pivot = a[position * count + position]
        if pivot <= SINGULAR * max(matrix[row * n + row], 0.0) or pivot <= 0.0:
            continue
        found[chosen] = row
        chosen += 1
        for i in range(count):
            column[i], entries[i] = a[i * count + position] / pivot, a[position * count + i]
        for i in range(count):
            if column[i] != 0.0:
                for j in range(count):
                    a[i * count + j] -= column[i] * entries[j]
    return chosen


def lemke(n: int, matrix: Array, right: Array, z: Array) -> bool:
    """z ≥ 0 (n,) with w = M z + q ≥ 0 and w z = 0; False where the method ends on a ray.

    Ties are resolved by the lexicographic rule, so that the method ends.
    """
    width, row = 2 * n + 2, 0
    tableau, basis, factors = zeros(n * width), integers(n), zeros(n)
    positive = True
    for i in range(n):
        z[i] = 0.0
        positive = positive and right[i] >= 0.0
        row = i if right[i] <= right[row] else row  # of several the last, which the lexicographic rule prefers
    if positive:
        return True
    # Columns: w (n), z (n), z0, q. Rows: I w - M z - d z0 = q.
    for i in range(n):
        basis[i] = i
        tableau[i * width + i] = 1.0
        for j in range(n):
            tableau[i * width + n + j] = -matrix[i * n + j]
        tableau[i * width + 2 * n] = -1.0
        tableau[i * width + 2 * n + 1] = right[i]
    entering = 2 * n
    for _ in range(60 * (n + 1)):
        leaving = basis[row]
        exchange(n, width, tableau, factors, row, entering)
        basis[row] = entering
        if leaving == 2 * n:
            for i in range(n):
                if n <= basis[i] and basis[i] < 2 * n:
                    z[basis[i] - n] = max(tableau[i * width + 2 * n + 1], 0.0)
            return True
        entering = leaving + n if leaving < n else leaving - n
        row = leaving_row(n, width, tableau, basis, entering)
        if row < 0:
            return False
    return False


def exchange(n: int, width: int, tableau: Array, factors: Array, row: int, column: int) -> None:
    """Solve a row for the variable of a column, and eliminate that from all others."""
    pivot = tableau[row * width + column]
    for j in range(width):
        tableau[row * width + j] /= pivot
    for i in range(n):
        factors[i] = tableau[i * width + column]
    for i in range(n):
        if i != row:
            for j in range(width):
                tableau[i * width + j] -= factors[i] * tableau[row * width + j]
            tableau[i * width + column] = 0.0
    tableau[row * width + column] = 1.0


def leaving_row(n: int, width: int, tableau: Array, basis: Integers, column: int) -> int:
    """The row with the lexicographically least ratio, that of z0 where it is among the least; -1 without any."""
    largest, count = 0.0, 0
    tied = integers(n)
    for i in range(n):
        largest = max(largest, abs(tableau[i * width + column]))
    limit = ZERO_ENTRY * max(1.0, largest)
    least_ratio = math.inf
    for i in range(n):
        if tableau[i * width + column] > limit:
            least_ratio = min(least_ratio, tableau[i * width + 2 * n + 1] / tableau[i * width + column])
    for i in range(n):
        if tableau[i * width + column] > limit:
            ratio = tableau[i * width + 2 * n + 1] / tableau[i * width + column]
            if ratio <= least_ratio + ZERO_ENTRY * max(1.0, abs(least_ratio)):
                tied[count] = i
                count += 1
    if count == 0:
        return -1
    for i in range(count):
        if basis[tied[i]] == 2 * n:
            return tied[i]
    for index in range(n):
        if count == 1:
            break
        least_ratio = math.inf
        for i in range(count):
            least_ratio = min(least_ratio, tableau[tied[i] * width + index] / tableau[tied[i] * width + column])
        kept = 0
        for i in range(count):
            if tableau[tied[i] * width + index] / tableau[tied[i] * width + column] <= least_ratio + ZERO_ENTRY:
                tied[kept] = tied[i]
                kept += 1
        count = kept
    return tied[0]
