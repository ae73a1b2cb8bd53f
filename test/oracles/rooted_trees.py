"""Rooted trees and order conditions (Hairer, Nørsett & Wanner I, sec. II.2; Hairer & Wanner II, sec. IV.7)."""

from __future__ import annotations

from functools import cache
from itertools import combinations_with_replacement, groupby
from math import factorial, prod

import numpy as np


@cache
def trees(order):
    """The rooted trees with this many nodes, each a sorted tuple of the subtrees at its root."""
    if order == 1:
        return [()]

    def forests(nodes, largest):
        if nodes == 0:
            yield ()
        for size in range(min(nodes, largest), 0, -1):
            for count in range(1, nodes // size + 1):
                for chosen in combinations_with_replacement(trees(size), count):
                    for rest in forests(nodes - size * count, size - 1):
                        yield chosen + rest

    return list(forests(order - 1, order - 1))


def nodes(tree):
    return 1 + sum(map(nodes, tree))


def density(tree):
    """The density γ: the order condition of the tree is Σ b Φ = 1/γ."""
    return nodes(tree) * prod(map(density, tree))


def weights(tree, a, single=None):
    """Φ (stages,): the elementary weight of a tree.

    :param single: the matrix in place of `a` at nodes with a single branch: α + Γ for Rosenbrock methods.
    """
    chosen = single if single is not None and len(tree) == 1 else a
    found = np.ones(len(a))
    for branch in tree:
        found = found * (chosen @ weights(branch, a, single))
    return found


def symmetry(tree):
    """The number of automorphisms of a tree."""
    return prod(
        symmetry(branch) ** len(alike) * factorial(len(alike))
        for branch, alike in ((branch, list(group)) for branch, group in groupby(tree))
    )
