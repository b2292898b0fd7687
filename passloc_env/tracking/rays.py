"""The point closest to many rays, exactly, for a batch of problems at once.

Seen from a station ``p``, a point ``s`` lies ``u·(s − p)`` along the ray of bearing ``θ`` and ``n·(s − p)`` across it,
with ``u = (sin θ, cos θ)`` and ``n = (cos θ, −sin θ)``, to starboard. Its squared distance to the ray is the square of
the latter, plus that of the former where the point is behind the station.

All points are relative to the stations' centroid: no digits are lost where coordinates are large, and where equations
leave a direction free, the smallest solution is the one closest to the centroid.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from passloc_env.angles import sine_cosine
from passloc_env.arrays import Array, BoolArray, IntArray, rows
from passloc_env.linalg import tree_sum

_PARALLEL = 1e-12
"""Lines are parallel when their mean square angle to a common direction is below this: a microradian squared."""

_ROUNDING = 1e-12
"""A step this small beside the distances involved moves rounding errors only."""

_WORTHWHILE = 0.01
"""A full step is taken if it descends by this share of what the equations of its set promise."""

_ROUNDS = 50
"""Sets of rays tried before a column is left where it is; none of fifty million random problems took more than 6."""


class Symmetric(NamedTuple):
    """Symmetric 2 × 2 matrices, each entry ``(N,)``."""

    xx: Array
    xy: Array
    yy: Array

    @property
    def determinant(self) -> Array:
        """``(N,)``."""
        return self.xx * self.yy - self.xy * self.xy

    @property
    def regular(self) -> BoolArray:
        """Whether lines with this normal matrix cross: determinant over squared trace is the angle squared."""
        return self.determinant > _PARALLEL * np.square(self.xx + self.yy)

    def solve(self, right: Array) -> Array:
        """``A⁻¹ b (2, N)``; with the pseudo-inverse ``A / trace²`` of rank one where the matrix is singular."""
        # A power of two changes no digit, and the determinant of a strong pull stays a number.
        power = np.ldexp(1.0, -np.frexp(np.maximum(self.xx, self.yy))[1])
        xx, xy, yy = scaled = Symmetric(self.xx * power, self.xy * power, self.yy * power)
        regular, right = scaled.regular, right * power
        scale = 1.0 / np.where(regular, scaled.determinant, np.square(xx + yy))
        x = np.where(regular, yy * right[0] - xy * right[1], xx * right[0] + xy * right[1])
        y = np.where(regular, xx * right[1] - xy * right[0], xy * right[0] + yy * right[1])
        return rows(x * scale, y * scale)

    def full(self) -> Array:
        """``(2, 2, N)``."""
        return np.array([[self.xx, self.xy], [self.xy, self.yy]])


class Seen(NamedTuple):
    """A point as the stations see it: how far along each ray, and across it, ``(M, N)``."""

    along: Array
    across: Array


@dataclass(frozen=True)
class Rays:
    """Rays, and a pull ``w |s − c|²`` towards a point.

    Attributes:
        sine: of the bearings ``(M, N)``.
        cosine: likewise.
        ahead: ``u·p`` of the stations ``(M, N)``.
        aside: ``n·p`` likewise.
        centre: ``c (2, N)``.
        weight: ``w (N,)``; zero for no pull.
    """

    sine: Array
    cosine: Array
    ahead: Array
    aside: Array
    centre: Array
    weight: Array

    @classmethod
    def from_stations(cls, stations: Array, bearings: Array, centre: Array, weight: Array) -> Rays:
        """Rays from stations ``(2, M, N)`` along compass bearings ``(M, N)``."""
        east, north = stations
        sine, cosine = sine_cosine(bearings)
        return cls(sine, cosine, sine * east + cosine * north, cosine * east - sine * north, centre, weight)

    def only(self, there: BoolArray) -> Rays:
        """The same without the rays that are not ``there (M, N)``: without direction, and with no point behind them."""
        sine, cosine, aside = (np.where(there, array, 0.0) for array in (self.sine, self.cosine, self.aside))
        return Rays(sine, cosine, np.where(there, self.ahead, -1.0), aside, self.centre, self.weight)

    def of(self, columns: IntArray) -> Rays:
        """The rays of some columns."""
        batch = (self.sine, self.cosine, self.ahead, self.aside, self.centre, self.weight)
        return Rays(*(array[..., columns] for array in batch))

    def seen(self, point: Array) -> Seen:
        """``(2, N)`` as the stations see it; a station sees itself at exactly zero."""
        along = self.sine * point[0]
        along += self.cosine * point[1]
        along -= self.ahead
        across = self.cosine * point[0]
        across -= self.sine * point[1]
        across -= self.aside
        return Seen(along, across)

    def mean_square(self) -> Array:
        """Mean squared distance of the stations from their centroid ``(N,)``."""
        return tree_sum(self.ahead * self.ahead + self.aside * self.aside) / len(self.ahead)

    def cost(self, point: Array, seen: Seen) -> Array:
        """Squared distances to all rays, and the pull, ``(N,)``."""
        short = np.minimum(seen.along, 0.0)
        offset = point - self.centre
        return tree_sum(seen.across * seen.across + short * short) + self.weight * tree_sum(offset * offset)

    def slope(self, point: Array, seen: Seen, behind: BoolArray | None = None) -> Array:
        """Half the gradient of the cost ``(2, N)``.

        Where stations have the point ``behind (M, N)`` them, the ray is but its station; None for nowhere: then rays
        are lines.
        """
        x, y = self.cosine * seen.across, -self.sine * seen.across
        if behind is not None:
            short = np.where(behind, seen.along, 0.0)
            x += self.sine * short
            y += self.cosine * short
        return rows(tree_sum(x), tree_sum(y)) + self.weight * (point - self.centre)

    def normal(self, behind: BoolArray | None = None) -> Symmetric:
        """Half the Hessian of the cost, in the same cases."""
        xx, xy, yy = self.cosine * self.cosine, -self.sine * self.cosine, self.sine * self.sine
        if behind is not None:
            xx, xy, yy = np.where(behind, 1.0, xx), np.where(behind, 0.0, xy), np.where(behind, 1.0, yy)
        return Symmetric(tree_sum(xx) + self.weight, tree_sum(xy), tree_sum(yy) + self.weight)


def crossing(rays: Rays) -> Array:
    """The point closest to all lines ``(2, N)``; of parallel lines the one closest to the centroid."""
    normal = rays.normal()
    return _corrected(rays, _first_crossing(rays, normal), normal)


def closest(rays: Rays) -> tuple[Array, BoolArray, Symmetric]:
    """The point closest to all rays, and the set it was solved for.

    The cost is convex with a continuous gradient, and quadratic for each set of stations that have the point behind
    them: one linear system per set. Newton's method, from the crossing of the lines: solve for the set found at the
    last point, until the set stays. A step that hardly descends is cut to the lowest point along it. Full steps alone
    can go to and fro for ever, where rays on parallel lines point away from each other; with that safeguard they end
    after finitely many sets.

    Returns:
        The point ``(2, N)``, which stations have it behind them ``(M, N)``, and half the Hessian of the cost.
    """
    point = _first_crossing(rays, rays.normal())
    behind = rays.seen(point).along <= 0.0
    unsettled = np.flatnonzero(np.logical_or.reduce(behind, axis=0))
    for _ in range(_ROUNDS):
        if not len(unsettled):
            break
        end, after, restless = _advanced(rays.of(unsettled), point[:, unsettled], behind[:, unsettled])
        point[:, unsettled], behind[:, unsettled] = end, after
        unsettled = unsettled[restless]
    normal = rays.normal(behind)
    return _corrected(rays, point, normal, behind), behind, normal


def _first_crossing(rays: Rays, normal: Symmetric) -> Array:
    """The crossing of the lines as the normal equations have it.

    They are solved from the pull's centre: along parallel lines, where no line says anything, the point stays abreast
    of it, however weak the pull.
    """
    return rays.centre - normal.solve(rays.slope(rays.centre, rays.seen(rays.centre)))


def _corrected(rays: Rays, point: Array, normal: Symmetric, behind: BoolArray | None = None) -> Array:
    """The point after one more step: it takes back what normal equations lose where lines are nearly parallel."""
    return point - normal.solve(rays.slope(point, rays.seen(point), behind))


def _advanced(rays: Rays, start: Array, behind: BoolArray) -> tuple[Array, BoolArray, BoolArray]:
    """One step of Newton's method: the new point, who has it behind, and ``(N,)`` whether there is more to do."""
    seen = rays.seen(start)
    slope = rays.slope(start, seen, behind)
    step = rays.normal(behind).solve(slope)
    end = start - step
    view = rays.seen(end)
    after = view.along <= 0.0
    size = tree_sum(end * end) + rays.mean_square()
    restless = np.logical_or.reduce(after != behind, axis=0) & (tree_sum(step * step) > _ROUNDING**2 * size)
    promise = tree_sum(step * slope)
    poor = np.flatnonzero(restless & (rays.cost(start, seen) - rays.cost(end, view) < _WORTHWHILE * promise))
    if len(poor):
        few = rays.of(poor)
        end[:, poor] = _lowest(few, start[:, poor], step[:, poor])
        after[:, poor] = few.seen(end[:, poor]).along <= 0.0
    return end, after, restless


def _lowest(rays: Rays, start: Array, step: Array) -> Array:
    """The point of least cost ``(2, N)`` between ``start`` and ``start − step``.

    Along the way the derivative rises, linearly between the places abreast of stations: bisect among those places,
    then interpolate.
    """

    def derivative(share: Array) -> Array:
        point = start - share * step
        seen = rays.seen(point)
        return -tree_sum(step * rays.slope(point, seen, seen.along <= 0.0))

    low, high = np.zeros(start.shape[-1]), np.ones(start.shape[-1])
    falling, rising = derivative(low), derivative(high)
    speed = rays.sine * step[0] + rays.cosine * step[1]
    for abreast in rays.seen(start).along / np.where(speed == 0.0, np.inf, speed):
        middle = np.clip(abreast, low, high)
        value = derivative(middle)
        down = value < 0.0
        low, falling = np.where(down, middle, low), np.where(down, value, falling)
        high, rising = np.where(down, high, middle), np.where(down, rising, value)
    turns = rising > 0.0
    share = low - (high - low) * falling / np.where(turns, rising - falling, 1.0)
    return start - np.where(turns, share, 1.0) * step
