"""Cross fixes: one point from the bearings that several stations take at the same time.

Four estimators: lines through slopes, lines through directions, rays, and maximum likelihood. The first three compete
in Shen et al. 2014 (paper 004), where bearings err by up to ±45°.

A compass bearing ``θ`` has ``u = (sin θ, cos θ)`` along it and ``n = (cos θ, −sin θ)`` to starboard of it: seen from a
station ``p``, a point ``s`` lies ``u·(s − p)`` along the ray and ``e = n·(s − p)`` across it.

Shapes: stations ``(2, M, N)``, east and north; bearings ``(M, N)``, rad; fixes ``(2, N)`` in the unit of the stations.
A column's fix has the same bits in every batch. Where bearings determine no point (:func:`determined`) it is, of all
the points that fit equally well, the one closest to the stations' centroid; it is never NaN.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from passloc_env.arrays import Array, BoolArray, rows
from passloc_env.checks import as_floats, require_exactly, require_finite
from passloc_env.errors import InputError
from passloc_env.linalg import tree_sum
from passloc_env.tracking.bearing_likelihood import likeliest
from passloc_env.tracking.rays import Rays, closest, crossing

_ONE_PLACE = 1e-12
"""Stations stand in one place when they are closer than this share of their coordinates."""

_STEEPEST = 1e6
"""Slope of a line along north, and of every other that is steeper."""


class Fix(NamedTuple):
    """Where rays meet, and how well they do.

    Attributes:
        position: ``(2, N)``.
        information: half the Hessian of the sum of squared distances, ``(2, 2, N)``: ``n nᵀ`` for each active ray, the
            identity for each other one, the weight of the pull times the identity.
        residual: the sum itself, ``(N,)``.
        active: whether the fix is ahead of the station, that is, its range positive, ``(M, N)``.
    """

    position: Array
    information: Array
    residual: Array
    active: BoolArray


def tangent_least_squares(stations: Array, bearings: Array) -> Array:
    """Least squares of lines ``north = slope · east + b``: Shen et al. 2014 (paper 004), eq. 4.

    Minimises ``Σ e² / cos² φ`` with φ the angle from the east axis. Steep lines count most, hence the fix depends on
    where north is. A line along north has no slope; it gets 1e6, as does any line steeper than that.

    Args:
        stations: ``(2, M, N)``.
        bearings: ``(M, N)``, rad.

    Returns:
        ``(2, N)``; lines reach backwards too, so the fix may lie behind stations.

    Raises:
        InputError: wrong shapes, fewer than two stations, numbers that are not finite.
    """
    view = _view(stations, bearings)
    (east, north), sine, cosine, known = view.stations, view.rays.sine, view.rays.cosine, view.determined
    # A line has no front, so that north and south must get the same slope: no sign here.
    steep = np.abs(cosine) >= _STEEPEST * np.abs(sine)
    slope = np.where(steep, _STEEPEST, cosine / np.where(steep, 1.0, sine))
    deviation = slope - tree_sum(slope.copy()) / len(slope)
    power = np.where(known, tree_sum(deviation * deviation), 1.0)
    x = np.where(known, tree_sum(deviation * (slope * east - north)) / power, 0.0)
    y = np.where(known, tree_sum(slope * (x - east) + north) / len(slope), 0.0)
    return view.centroid + rows(x, y)


def least_squares(stations: Array, bearings: Array) -> Array:
    """The point closest to all bearing lines, ``min Σ e²``: Shen et al. 2014 (paper 004), eq. 8.

    The paper proves it equal to :func:`tangent_least_squares`. For two stations it is; from three on the weights
    differ, and so do the fixes.

    Args:
        stations: ``(2, M, N)``.
        bearings: ``(M, N)``, rad.

    Returns:
        ``(2, N)``; lines reach backwards too, so the fix may lie behind stations.

    Raises:
        InputError: wrong shapes, fewer than two stations, numbers that are not finite.
    """
    view = _view(stations, bearings)
    return view.centroid + crossing(view.rays)


def positive_range_least_squares(stations: Array, bearings: Array) -> Array:
    """The point closest to all bearing *rays*: Shen et al. 2014 (paper 004), eq. 12 with ``r ≥ 0``.

    Args:
        stations: ``(2, M, N)``.
        bearings: ``(M, N)``, rad.

    Returns:
        ``(2, N)``; :func:`positive_range_fix` tells more of it.

    Raises:
        InputError: wrong shapes, fewer than two stations, numbers that are not finite.
    """
    return positive_range_fix(stations, bearings).position


def positive_range_fix(stations: Array, bearings: Array, pull: tuple[Array, Array] | None = None) -> Fix:
    """The point closest to all bearing rays and, if wanted, to a place believed in before.

    Minimises ``Σ (e² + min(u·(s − p), 0)²) + w |s − c|²``: Shen et al. 2014 (paper 004), eq. 12, with its ranges
    eliminated and a pull added. Where the bearings determine no point, the fix is the one of all that fit equally well
    that lies closest to the centre of the pull, however weak.

    Args:
        stations: ``(2, M, N)``; beside a pull a single one will do.
        bearings: ``(M, N)``, rad.
        pull: centre ``c (2, N)`` and weight ``w (N,)``, not negative; a ray has weight one.

    Returns:
        The fix, exact up to rounding.

    Raises:
        InputError: wrong shapes, too few stations, numbers that are not finite, negative weights.
    """
    view = _view(stations, bearings, 2 if pull is None else 1)
    rays = view.rays if pull is None else _pulled(view, pull)
    point, behind, normal = closest(rays)
    return Fix(view.centroid + point, normal.full(), rays.cost(point, rays.seen(point)), ~behind)


def maximum_likelihood(stations: Array, bearings: Array) -> Array:
    """The point that explains bearings with equal Gaussian errors best: ``min Σ wrap(θ − bearing of s)²``.

    Damped Newton steps from the positive-range fix and from the best of five probes along each ray; the best end is
    kept, and is the global maximum in all but one of some thousand scenes with errors of 45°. Such errors often leave
    the likelihood without a maximum, with but a supremum: at a station, whose own bearing is met from the right side
    only, or infinitely far out. The fix is then that station, or the point in the best direction at 1000 root mean
    square distances of the stations from their centroid. Where :func:`determined` says no, it is the positive-range
    fix.

    Args:
        stations: ``(2, M, N)``.
        bearings: ``(M, N)``, rad.

    Returns:
        ``(2, N)``.

    Raises:
        InputError: wrong shapes, fewer than two stations, numbers that are not finite.
    """
    view = _view(stations, bearings)
    point = closest(view.rays)[0]
    known = np.flatnonzero(view.determined)
    point[:, known] = likeliest(view.stations[..., known], view.bearings[:, known], point[:, known])
    return view.centroid + point


def determined(stations: Array, bearings: Array) -> BoolArray:
    """Whether bearing lines fix a point: not all of them parallel, nor all stations in one place.

    Parallel are lines within a microradian (root mean square) of a common direction, whichever way they point; one
    place is 1e-12 of the largest coordinate.

    Args:
        stations: ``(2, M, N)``; a single one determines nothing.
        bearings: ``(M, N)``, rad.

    Returns:
        ``(N,)``.

    Raises:
        InputError: wrong shapes, no stations, numbers that are not finite.
    """
    return _view(stations, bearings, 1).determined


class _View(NamedTuple):
    """What was given, relative to the stations' centroid."""

    centroid: Array
    stations: Array
    bearings: Array
    rays: Rays

    @property
    def determined(self) -> BoolArray:
        width = np.maximum.reduce(np.abs(self.stations), axis=(0, 1))
        apart = width > _ONE_PLACE * np.maximum.reduce(np.abs(self.centroid), axis=0)
        return apart & self.rays.normal().regular


def _view(stations: ArrayLike, bearings: ArrayLike, least: int = 2) -> _View:
    """Checks shapes and numbers, and moves the origin."""
    places, angles = as_floats("stations", stations), as_floats("bearings", bearings)
    if places.ndim != 3 or len(places) != 2 or places.shape[1] < least:
        raise InputError(f"stations of shape {places.shape} is not possible: must be (2, M, N) with M ≥ {least}")
    require_finite("stations", places)
    require_exactly("bearings", angles, places.shape[1:])
    centroid = tree_sum(places.swapaxes(0, 1).copy()) / places.shape[1]
    places = places - centroid[:, None]
    free = np.zeros(centroid.shape), np.zeros(centroid.shape[1])
    return _View(centroid, places, angles, Rays.from_stations(places, angles, *free))


def _pulled(view: _View, pull: tuple[ArrayLike, ArrayLike]) -> Rays:
    """The rays with a pull, checked."""
    if not isinstance(pull, tuple) or len(pull) != 2:
        raise InputError(f"pull = {' '.join(str(pull).split())[:40]} is not possible: must be (centre, weight)")
    place = require_exactly("the pull's centre", pull[0], view.centroid.shape)
    strength = require_exactly("the pull's weight", pull[1], view.centroid.shape[1:])
    if (strength < 0.0).any():
        raise InputError(f"the pull's weight = {strength.min()} is not possible: must not be negative")
    # Without weight it is no pull, and chooses none of the points that fit equally well.
    return replace(view.rays, centre=np.where(strength > 0.0, place - view.centroid, 0.0), weight=strength)
