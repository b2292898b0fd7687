"""Frames in space: the rotating Earth-centred frame (ECEF, WGS-84), local axes on the ellipsoid, and turning bodies.

The ellipsoid itself is pymap3d's business, imported on first use; everything else is algebra on arrays ``(3, …, N)``.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from passloc_env.arrays import Array, BoolArray, blank, rows, zeros
from passloc_env.linalg import inner

EARTH_RADIUS = 6_378_137.0
"""Equatorial radius of WGS-84, m."""

_POLAR_RADIUS = 6_356_752.314245
EARTH_RATE = 7.292115e-5
"""Rotation of the Earth, rad/s."""

EARTH_GRAVITY = 3.986004418e14
"""Gravitational constant times the mass of the Earth, m³/s²."""

_NEWTON_STEPS = 3
"""From the ellipsoid blown up by the height, which is at most metres off, to nanometres."""


class Geodetic(NamedTuple):
    """Place on or above the ellipsoid; radians and metres."""

    latitude: Array
    longitude: Array
    height: Array


def geodetic(position: Array) -> Geodetic:
    """Geodetic latitude, longitude and height of ECEF positions ``(3, N)``."""
    from pymap3d.ecef import ecef2geodetic

    # pymap3d turns arrays of one into scalars.
    return Geodetic(*(np.reshape(value, position.shape[1:]) for value in ecef2geodetic(*position, deg=False)))


def from_geodetic(latitude: Array, longitude: Array, height: Array) -> Array:
    """ECEF position ``(3, N)``, m."""
    from pymap3d.ecef import geodetic2ecef

    axes = geodetic2ecef(latitude, longitude, height, deg=False)
    return rows(*(np.reshape(axis, np.shape(latitude)) for axis in axes))


def local_axes(latitude: Array, longitude: Array) -> Array:
    """East, north and up as rows ``(3, 3, N)``, in ECEF."""
    sin_lat, cos_lat = np.sin(latitude), np.cos(latitude)
    sin_lon, cos_lon = np.sin(longitude), np.cos(longitude)
    east = rows(-sin_lon, cos_lon, zeros(sin_lon, np.shape(sin_lon)))
    north = rows(-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat)
    up = rows(cos_lat * cos_lon, cos_lat * sin_lon, sin_lat)
    return rows(east, north, up)


def course(position: Array, velocity: Array) -> Array:
    """Course over ground ``(N,)``, rad clockwise from north, of ECEF positions and velocities ``(3, N)``."""
    place = geodetic(position)
    east, north, _ = local_axes(place.latitude, place.longitude)
    heading: Array = np.arctan2(inner(east, velocity), inner(north, velocity))
    return heading


class HeightFix(NamedTuple):
    """Where a line of sight meets a height above the ellipsoid.

    Attributes:
        position: ``(3, N)``; where the line does not meet the height, its point nearest to the Earth's centre.
        hit: whether it comes down to the height ``(N,)``; from below a height none does.
        normal: gradient of the height there, a unit vector ``(3, N)``.
    """

    position: Array
    hit: BoolArray
    normal: Array


def meet_height(origin: Array, towards: Array, height: Any) -> HeightFix:
    """The nearer point at which the line from ``origin (3, N)`` along unit vectors ``(3, N)`` has a geodetic height.

    The first guess is the ellipsoid with both axes longer by the height; Newton's method does the rest.
    """
    stretch = rows(*(np.broadcast_to(1.0 / (radius + height), towards.shape[1:]) for radius in _AXES))
    a, u = origin * stretch, towards * stretch
    square, half, rest = inner(u, u), inner(a, u), inner(a, a) - 1.0
    discriminant = half * half - square * rest
    hit = (discriminant >= 0.0) & (half < 0.0) & (rest > 0.0)
    distance = (-half - np.sqrt(np.maximum(discriminant, 0.0))) / square
    nearest = np.maximum(-inner(origin, towards), 0.0)
    distance = np.where(hit, distance, nearest)
    for _ in range(_NEWTON_STEPS):
        place = geodetic(origin + distance * towards)
        normal = local_axes(place.latitude, place.longitude)[2]
        slope = np.where(hit, inner(normal, towards), 1.0)
        distance = np.where(hit, distance - (place.height - height) / slope, distance)
    position = origin + distance * towards
    place = geodetic(position)
    return HeightFix(position, hit, local_axes(place.latitude, place.longitude)[2])


_AXES = (EARTH_RADIUS, EARTH_RADIUS, _POLAR_RADIUS)


def below_horizon(observer: Array, point: Array) -> BoolArray:
    """Whether the Earth stands between positions ``(3, N)``: the line between them dips into the ellipsoid."""
    stretch = 1.0 / np.array(_AXES).reshape(3, *(1,) * (observer.ndim - 1))
    start, line = observer * stretch, (point - observer) * stretch
    length = np.maximum(inner(line, line), 1e-300)
    share = -inner(start, line) / length
    nearest = start + np.minimum(np.maximum(share, 0.0), 1.0) * line
    hidden: BoolArray = (share < 1.0) & (inner(nearest, nearest) < 1.0)
    return hidden


def cross(a: Array, b: Array) -> Array:
    """Vector product of ``(3, …)`` and ``(3, …)``."""
    return rows(a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def turned_body(axes: Array, rotation: Array) -> Array:
    """Body axes (rows of ``(3, 3, N)``) after a rotation ``(3, N)`` in radians about themselves, by Rodrigues.

    Each axis ``b`` becomes ``b + sin θ k × b + (1 − cos θ) k × (k × b)`` for the unit vector k of the rotation.
    """
    vector = sum(rotation[i] * axes[i] for i in range(3))
    angle = np.sqrt(inner(rotation, rotation))
    still = angle == 0.0
    safe = np.where(still, 1.0, angle)
    sine = np.where(still, 1.0, np.sin(angle) / safe)
    versine = np.where(still, 0.5, (1.0 - np.cos(angle)) / (safe * safe))
    turned = blank(axes, axes.shape)
    for i in range(3):
        once = cross(vector, axes[i])
        turned[i] = axes[i] + sine * once + versine * cross(vector, once)
    return turned
