"""Where bearings with equal Gaussian errors have their largest likelihood, for a batch of problems at once.

The sum of squared wrapped residuals ``Σ ε²`` has many minima in the plane, and often none at all: it may fall all the
way to a station, whose own bearing is met from one side only as long as the point is not quite there, or all the way
out. Those limits are candidates beside the minima.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from passloc_env.angles import TURN, direction, wrap
from passloc_env.arrays import Array, rows
from passloc_env.linalg import tree_sum
from passloc_env.tracking.rays import Rays, Symmetric

FAR = 1e3
"""Beyond this many root mean square distances of the stations from their centroid a point is infinitely far."""

_RUNGS = (0.1, 0.3, 1.0, 3.0, 10.0)
"""Where the likelihood is probed along each ray for a start, in the same unit."""

_CLIMBS = 40
"""Steps from each start: a dozen is common, and whoever still moves is on the way to a station or to infinity."""

_STILL = 1e-9
"""A climb ends with a step that changes bearings by less than this, rad."""

_DAMPING, _FASTER, _SLOWER = 0.1, 0.1, 8.0
"""Damping at the start, and its factors after a step that descends and one that does not."""


def likeliest(stations: Array, bearings: Array, start: Array) -> Array:
    """The point ``(2, N)`` of least ``Σ ε²``.

    Args:
        stations: relative to their centroid ``(2, M, N)``, not all in one place.
        bearings: ``(M, N)``, rad.
        start: a first guess ``(2, N)``, relative to the same.
    """
    rays = Rays.from_stations(stations, bearings, start, np.zeros(start.shape[1]))
    size = np.sqrt(rays.mean_square())
    best, least = start, np.full(len(size), np.inf)
    for point, cost in _candidates(rays, stations, bearings, start, size):
        better = cost < least
        best, least = np.where(better, point, best), np.where(better, cost, least)
    return best


def _candidates(
    rays: Rays, stations: Array, bearings: Array, start: Array, size: Array
) -> Iterator[tuple[Array, Array]]:
    """Points ``(2, N)`` and their costs ``(N,)``: ends of climbs, stations, infinity."""
    yield _climbed(rays, start, size)
    count = len(bearings)
    for index in range(count):
        station = stations[:, index]
        # A station sees itself at exactly zero: its residual is arctan2(0, 0) = 0, the limit from the best side.
        yield station, _cost(rays, station)
        rungs = [station + rung * size * direction(bearings[index]) for rung in _RUNGS]
        yield _climbed(rays, _best(rays, rungs), size)
    mean = tree_sum(bearings.copy()) / count
    for turns in range(count):
        # The mean direction by least squares is the plain mean of the angles, some of them taken a turn higher.
        outward = mean + turns * (TURN / count)
        residual = wrap(bearings - outward)
        yield FAR * size * direction(outward), tree_sum(residual * residual)


def _cost(rays: Rays, point: Array) -> Array:
    """``Σ ε² (N,)``; the residual is the angle between ray and sight line, wrapped as it comes."""
    seen = rays.seen(point)
    residual = np.arctan2(seen.across, seen.along)
    return tree_sum(residual * residual)


def _best(rays: Rays, points: list[Array]) -> Array:
    """The best of some points, column by column."""
    best, least = points[0], _cost(rays, points[0])
    for point in points[1:]:
        cost = _cost(rays, point)
        better = cost < least
        best, least = np.where(better, point, best), np.where(better, cost, least)
    return best


def _climbed(rays: Rays, start: Array, size: Array) -> tuple[Array, Array]:
    """The minimum that damped Newton steps reach from a start ``(2, N)``, and its cost; inf where it ran far out."""
    point, cost = start.copy(), _cost(rays, start)
    damping = np.full(len(size), _DAMPING)
    moving = np.arange(len(size))
    for _ in range(_CLIMBS):
        if not len(moving):
            break
        part, here, mu = rays.of(moving), point[:, moving], damping[moving]
        step, scale = _newton_step(part, here, mu, size[moving])
        there = here + step
        value = _cost(part, there)
        better = value < cost[moving]
        point[:, moving] = np.where(better, there, here)
        cost[moving] = np.where(better, value, cost[moving])
        damping[moving] = mu * np.where(better, _FASTER, _SLOWER)
        inside = tree_sum(there * there) < np.square(FAR * size[moving])
        moving = moving[(tree_sum(step * step) * scale > _STILL**2) & (inside | ~better)]
    cost[tree_sum(point * point) >= np.square(FAR * size)] = np.inf
    return point, cost


def _newton_step(rays: Rays, point: Array, damping: Array, size: Array) -> tuple[Array, Array]:
    """A descending step ``(2, N)``, and the squared bearing change it makes per squared length, ``Σ 1/r²``.

    The Hessian is the full one: with residuals of 45° its second derivatives decide. It is lifted to be positive.
    """
    along, across = rays.seen(point)
    residual = np.arctan2(across, along)
    # Not closer than a billionth: beside a station the gradient has no limit.
    square = np.maximum(along * along + across * across, 1e-18 * np.square(size))
    along, across = along / square, across / square
    x, y = rays.cosine * along - rays.sine * across, -rays.sine * along - rays.cosine * across
    gradient = rows(tree_sum(residual * x), tree_sum(residual * y))
    scale = tree_sum(x * x + y * y)
    bend = 2.0 * residual * x * y
    xx, yy = tree_sum(x * x + bend), tree_sum(y * y - bend)
    xy = tree_sum(x * y + residual * (y * y - x * x))
    lowest = 0.5 * (xx + yy) - np.hypot(0.5 * (xx - yy), xy)
    lift = damping * scale + 2.0 * np.maximum(-lowest, 0.0)
    return -Symmetric(xx + lift, xy, yy + lift).solve(gradient), scale
