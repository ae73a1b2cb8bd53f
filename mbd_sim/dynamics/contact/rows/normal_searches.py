"""The searches of the normal at which two corners, or a side and a corner, of two convex bodies meet.

A row makes Newton steps from a hint among its numbers. They change the normal, or where this may pass through the axis
of a rim, near which the support of the rim has a kink, the direction from the center of the rim: see `rounded_edges`
and `rims` in `simulation/contact/compiled/features/round`.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from mbd_sim.dynamics.constraints.rows import IteratedNormal

NEWTON_STEPS = 3
FEET = 2  # steps to the nearest point of an ellipsoid, which is all but there
TINY = 1e-60  # square below which a direction counts as zero: in slots without features
Found = tuple[IteratedNormal, ca.SX, tuple[ca.SX, ca.SX]]


@dataclass(frozen=True, eq=False)
class NormalSearch:
    """The search of the normal of two corners, with their `roots` R and the `line` between them; a side can bound it.

    It is `used` if it is 1, and 0 if the normal is fixed.
    """

    line: ca.SX
    roots: list[ca.SX]
    bound: ca.SX
    cosine: ca.SX
    side: ca.SX
    used: ca.SX

    def found(self, fixed: ca.SX, hint: ca.SX) -> Found:
        """What is iterated, the normal, and the directions in which both corners touch."""
        symbols, value = ca.SX.sym("normal", 3), fixed + self.used * hint
        for _ in range(NEWTON_STEPS):
            value = self.following(fixed, value)
        return IteratedNormal(symbols, value, self.following(fixed, symbols)), symbols, (symbols, symbols)

    def following(self, fixed: ca.SX, given: ca.SX) -> ca.SX:
        """The normal after one step from a given one."""
        step = _newton_step(given, self.bound, self.cosine, self.line, self.roots, self.side, self.used)
        return fixed + self.used * step


@dataclass(frozen=True, eq=False)
class RimSearch:
    """The search where one of the bodies has rims, and the other one rims, a side or the surface of an ellipsoid.

    Of a rim that touches another one, a side or an ellipsoid, the direction w from its center is iterated, as in
    `simulation/contact/compiled/features/round/rims.py`, times -1 if it is of the first body. It is `used` if it is 1;
    everything else is found by the search of normals, `others`.

    :param line: from the center of the other corner to that of the rim, with an `axis` and a `radius`.
    :param sign: 1 if the rim is of the first body, and -1 if it is of the second one.
    """

    line: ca.SX
    axis: ca.SX
    radius: ca.SX
    sign: ca.SX
    other: RevolvedAtRim | EllipsoidAtRim
    used: ca.SX
    others: NormalSearch

    def found(self, fixed: ca.SX, hint: ca.SX) -> Found:
        """See `NormalSearch`."""
        symbols, value = ca.SX.sym("direction", 3), fixed + (1.0 - self.used) * self.others.used * hint
        value += self.used * hint
        for _ in range(NEWTON_STEPS):
            value = self._following(fixed, value)
        iterated = IteratedNormal(symbols, value, self._following(fixed, symbols))
        at = self._at(symbols)
        normal = (1.0 - self.used) * symbols + self.used * self.sign * at.normal
        own, opposite = symbols, (1.0 - self.used) * symbols + self.used * self.sign * at.toward
        is_first = 0.5 * (1.0 + self.sign)
        first = is_first * own + (1.0 - is_first) * opposite
        return iterated, normal, (first, own + opposite - first)

    def _at(self, given: ca.SX) -> AtRim:
        """What a direction of the rim leads to."""
        outward = unit(-self.sign * (given - self.axis * ca.dot(self.axis, given)))
        tangent = ca.cross(self.axis, outward)
        return self.other.near(self.line + self.radius * outward, outward, tangent, self.radius, self.line)

    def _following(self, fixed: ca.SX, given: ca.SX) -> ca.SX:
        """The direction, or normal, after one of Newton's steps."""
        at = self._at(given)
        step = self.used * at.slope / (self.used * at.firm + 1.0 - self.used)
        return self.others.following(fixed, given) + self.used * -self.sign * unit(at.outward - step * at.tangent)


@dataclass(frozen=True, eq=False)
class AtRim:
    """A point of a rim, in the direction `outward` and with its `tangent`, and the other corner.

    The `slope` along the tangent is zero where both touch; `firm` is its derivative by the angle. There the `normal`
    leads to the rim, and `toward` is a direction along which the other corner reaches farthest at the same point.
    """

    outward: ca.SX
    tangent: ca.SX
    slope: ca.SX
    firm: ca.SX
    normal: ca.SX
    toward: ca.SX


@dataclass(frozen=True, eq=False)
class RevolvedAtRim:
    """Another rim, or where `on_side` is 1 a side with a `cosine`, which a rim touches."""

    axis: ca.SX
    radius: ca.SX
    cosine: ca.SX
    on_side: ca.SX

    def near(self, place: ca.SX, outward: ca.SX, tangent: ca.SX, radius: ca.SX, line: ca.SX) -> AtRim:
        """See `AtRim`.

        :param place: the point of the rim, which has a `radius`, from the center of this one.
        :param line: the center of that rim from that of this one.
        """
        level = place - self.axis * ca.dot(self.axis, place)
        size = ca.sqrt(ca.dot(level, level) + TINY)
        toward = level / size
        other, apart = ca.cross(self.axis, toward), place - self.radius * toward
        along, sine = ca.dot(tangent, other), ca.sqrt(1.0 - self.cosine * self.cosine)
        normal = unit(ca.cross(tangent, other))
        normal *= ca.if_else(ca.dot(normal, line) > 0.0, 1.0, -1.0)
        normal += self.on_side * (self.cosine * self.axis + sine * toward - normal)
        apart += self.on_side * (normal - apart)
        bend = self.radius + self.on_side * (-sine - self.radius)
        firm = radius * (1.0 - self.on_side - along * along * bend / size) - ca.dot(outward, apart)
        return AtRim(outward, tangent, ca.dot(tangent, apart), firm, normal, toward)


@dataclass(frozen=True, eq=False)
class EllipsoidAtRim:
    """An ellipsoid, which a rim touches, with its `axes` (3, 3) in ground's axes and its `radii`."""

    axes: ca.SX
    radii: tuple[float, float, float]
    used: ca.SX

    def near(self, place: ca.SX, outward: ca.SX, tangent: ca.SX, radius: ca.SX, line: ca.SX) -> AtRim:
        """See `RevolvedAtRim.near`; the nearest point has the parts r² z / (r² + λ) of the parts z of the place."""
        squares = ca.vertcat(*self.radii) ** 2
        own = self.used * (self.axes.T @ place) + (1.0 - self.used) * ca.vertcat(*self.radii)
        far = ca.SX(1, 1)
        for _ in range(FEET):
            shares = own * own * squares / (squares + far) ** 2
            far += 0.5 * (ca.sum1(shares) - 1.0) / ca.sum1(shares / (squares + far))
        gradient = own / (squares + far)
        size = ca.sqrt(ca.dot(gradient, gradient) + TINY)
        normal, along = self.axes @ (gradient / size), self.axes.T @ tangent
        firm = radius * ca.sum1(along * along / squares) / size - ca.dot(outward, normal)
        return AtRim(outward, tangent, ca.dot(tangent, normal), firm, normal, normal)


@dataclass(frozen=True, eq=False)
class RoundedSearch:
    """The search where one of the bodies is a rounded point or edge, and the other one has rims with this `axis`.

    Only the place of an edge at a rim is iterated: as the direction w from the center of the rim, which is smooth where
    the normal passes through the axis, and g(n) has a kink. With v, the line from the rim to the edge and across it, it
    is where (axis × w)·v = 0. All others are in closed form.
    """

    line: ca.SX
    edge: ca.SX
    side: ca.SX
    cosine: ca.SX
    axis: ca.SX
    radius: ca.SX
    used: ca.SX

    def found(self, fixed: ca.SX, hint: ca.SX) -> Found:
        """See `NormalSearch`."""
        on_edge = self.used * (ca.dot(self.edge, self.edge) > 0.5)
        on_side = self.used * (ca.dot(self.side, self.side) > 0.5)
        at_rim = on_edge * (self.radius > 0.0)
        symbols, value = ca.SX.sym("direction", 3), at_rim * hint
        for _ in range(NEWTON_STEPS):
            value = self._following(value, at_rim)
        iterated = IteratedNormal(symbols, value, self._following(symbols, at_rim))
        outward = unit(self.line - self.axis * ca.dot(self.axis, self.line))
        toward = at_rim * symbols + (self.used - at_rim) * outward
        normal = fixed + (self.used - on_side) * unit(self._across(self.line - self.radius * toward))
        normal += on_side * (self.cosine * self.side + ca.sqrt(1.0 - self.cosine * self.cosine) * outward)
        toward += (1.0 - self.used) * fixed
        return iterated, normal, (toward, toward)

    def _following(self, given: ca.SX, at_rim: ca.SX) -> ca.SX:
        """The direction after one of Newton's steps."""
        toward = unit(given - self.axis * ca.dot(self.axis, given))
        tangent, apart = ca.cross(self.axis, toward), self._across(self.line - self.radius * toward)
        along = ca.dot(self.edge, tangent)
        firm = ca.dot(toward, apart) + self.radius * (1.0 - along * along)
        return unit(toward + at_rim * ca.dot(tangent, apart) / (at_rim * firm + 1.0 - at_rim) * tangent)

    def _across(self, vector: ca.SX) -> ca.SX:
        return vector - self.edge * ca.dot(self.edge, vector)


def _newton_step(
    given: ca.SX, direction: ca.SX, cosine: ca.SX, line: ca.SX, roots: list[ca.SX], side: ca.SX, used: ca.SX
) -> ca.SX:
    """A step of n = k d + √(1 - k²) m toward the normal at which the gap is largest; d is zero where none is given."""
    bound, scale = ca.dot(direction, direction), ca.sqrt(1.0 - cosine * cosine)
    m = unit(given - direction * ca.dot(direction, given))
    one = unit(bound * ca.cross(direction, m) + (1.0 - bound) * ca.cross(side, m))
    other = (1.0 - bound) * ca.cross(m, one)
    normal = cosine * direction + scale * m
    slope, bend = line, ca.SX(3, 3)
    for root in roots:
        arm, size = farthest(root, normal)
        slope, bend = slope - arm, bend - (root.T @ root - arm @ arm.T) / size
    tangents = ca.horzcat(one, other)
    gradient = used * scale * (tangents.T @ slope)
    hessian = scale * scale * (tangents.T @ bend @ tangents) - scale * ca.dot(m, slope) * ca.SX.eye(2)
    hessian = used * hessian - (1.0 - used) * ca.SX.eye(2)
    hessian[1, 1] -= bound  # a side admits one direction only
    determinant = hessian[0, 0] * hessian[1, 1] - hessian[0, 1] * hessian[1, 0]
    first = (hessian[0, 1] * gradient[1] - hessian[1, 1] * gradient[0]) / determinant
    second = (hessian[1, 0] * gradient[0] - hessian[0, 0] * gradient[1]) / determinant
    return cosine * direction + scale * unit(m + first * one + second * other)


def farthest(root: ca.SX, normal: ca.SX) -> tuple[ca.SX, ca.SX]:
    """From a corner with K = Rᵀ R to its farthest point along the normal, and its reach √(n·K n) = |R n|.

    Of a rim, n·n - (n·a)² would be lost in round-off near its axis a, and could become negative.

    :param root: R.
    """
    fold = root @ normal
    size = ca.sqrt(ca.dot(fold, fold) + TINY)
    return root.T @ (fold / size), size


def unit(vector: ca.SX) -> ca.SX:
    """A vector divided by its length; zero remains so."""
    return vector / ca.sqrt(ca.dot(vector, vector) + TINY)
