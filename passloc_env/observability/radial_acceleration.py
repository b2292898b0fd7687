"""What radial acceleration, alone or with bearing, tells of a straight track: exact determinants in closed form.

The state is ``(D, L, v, φ)``: signed distance D of the closest approach, distance L travelled since, speed v and
direction φ of the track's normal. At ``i`` periods before the latest instant

    L_i = L − i v T,   r_i² = D² + L_i²,   a_i = D² v² / r_i³,   θ_i = atan2(L_i, D) + φ,

and the rows are derivatives with respect to the *latest* state (paper 002, eqs. 4, 7 and 12). A determinant is a degree
of observability in the paper's sense (eq. 6): the volume that errors of one unit in each measurement leave uncertain is
its inverse. D, L and v broadcast; results have their common shape.

A track through the observer has no radial acceleration and no bearing at the instant of contact. There, as everywhere
along a radial track, the determinants are zero; a range below 1e-60 m is a contact.
"""

from __future__ import annotations

import numpy as np

from passloc_env.arrays import Array
from passloc_env.checks import require_count, require_finite, require_positive
from passloc_env.errors import InputError

_CONTACT = 1e-60
"""Ranges below this, m, are none; powers of any other stay finite."""


def radial_acceleration_gram_determinant(
    closest_approach: Array | float, along_track: Array | float, speed: Array | float, period: float
) -> Array:
    """Determinant of three radial accelerations, a period apart, with respect to ``(D, L, v)``.

    ``det = −18 D⁷ v⁸ T³ / (r₀ r₁ r₂)⁵`` for every T, rows latest first (paper 002, eq. 10, which prints 42 for 18).

    Args:
        closest_approach: D, m.
        along_track: L at the latest instant, m.
        speed: v, m/s.
        period: T, s.

    Returns:
        Zero on radial tracks, finite unless it overflows.

    Raises:
        InputError: numbers that are not finite, shapes that do not match, a period that is not positive.
    """
    distance, along, speed = _track(closest_approach, along_track, speed, period)
    near, middle, far = _sorted_ranges(distance, along, speed, period, 3)
    # Only the nearest of three instants can be close to the observer: no quotient below exceeds 1 or 2/T.
    sines = _over(distance, near) ** 5 * _over(distance, middle) * _over(distance, far)
    with np.errstate(over="ignore"):
        determinant: Array = -18.0 * period**3 * sines * (_over(speed, middle) * _over(speed, far)) ** 4
    return determinant


def bearing_radial_acceleration_gram_determinant(
    closest_approach: Array | float, along_track: Array | float, speed: Array | float, period: float
) -> Array:
    """Determinant of two bearings and radial accelerations, a period apart, with respect to ``(D, L, v, φ)``.

    ``det = −3 D⁴ v⁵ T² / (r₀ r₁)⁵`` for every T, rows ``θ₀, a₀, θ₁, a₁`` latest first (paper 002, eq. 16).

    Args:
        closest_approach: D, m.
        along_track: L at the latest instant, m.
        speed: v, m/s.
        period: T, s.

    Returns:
        Zero on radial tracks, finite unless it overflows; grows without limit (as ``1/D``) towards a contact.

    Raises:
        InputError: numbers that are not finite, shapes that do not match, a period that is not positive.
    """
    distance, along, speed = _track(closest_approach, along_track, speed, period)
    near, far = _sorted_ranges(distance, along, speed, period, 2)
    sines = _over(distance, near) ** 4
    with np.errstate(over="ignore"):
        determinant: Array = -3.0 * period**2 * sines * _over(speed, near) * _over(speed, far) ** 4 * _over(1.0, far)
    return determinant


def degree_of_observability(range: Array | float, speed: Array | float, aspect: Array | float, period: float) -> Array:
    """``|det|`` of three radial accelerations whose instants are close together compared with the range.

    ``18 (v/r)⁸ T³ |sin χ|⁷`` with the angle χ between track and line of sight (paper 002, eq. 11, which prints 42 and a
    cosine).

    Args:
        range: r, m.
        speed: v, m/s.
        aspect: χ, rad; zero on a radial track.
        period: T, s.

    Returns:
        At least zero; zero at zero range, finite unless it overflows.

    Raises:
        InputError: numbers that are not finite, a negative range, shapes that do not match, a period that is not
            positive.
    """
    distance, speed, aspect = _finite(range=range, speed=speed, aspect=aspect)
    require_positive("period", period)
    if (distance < 0.0).any():
        raise InputError(f"range = {distance.min()} is not possible: must be at least 0")
    with np.errstate(over="ignore"):
        degree: Array = 18.0 * period**3 * _over(speed, distance) ** 8 * np.abs(np.sin(aspect)) ** 7
    return degree


def track_state_rows(
    closest_approach: Array | float,
    along_track: Array | float,
    speed: Array | float,
    period: float,
    instants: int,
    bearings: bool = False,
) -> Array:
    """Jacobian of the measurements at several instants with respect to the latest state (paper 002, eqs. 8, 13, 14).

    Args:
        closest_approach: D, m.
        along_track: L at the latest instant, m.
        speed: v, m/s.
        period: T, s.
        instants: how many, latest first.
        bearings: whether bearings are measured too; the state then has φ.

    Returns:
        ``(instants, 1, 3, …)`` for ``(a)`` by ``(D, L, v)``, or ``(instants, 2, 4, …)`` for ``(θ, a)`` by
        ``(D, L, v, φ)``; SI and radians. At a contact only ``∂θ/∂φ`` is not zero.

    Raises:
        InputError: numbers that are not finite, a period that is not positive, fewer than one
            instant or not a whole number of them.
    """
    distance, along, speed = _track(closest_approach, along_track, speed, period)
    require_count("instants", instants, at_least=1)
    age = period * np.arange(instants).reshape(-1, *(1,) * distance.ndim)
    offset = along - age * speed
    ranges = np.hypot(distance, offset)
    sine, cosine, quick, near = (_over(value, ranges) for value in (distance, offset, speed, 1.0))

    n = 4 if bearings else 3
    rows = np.zeros((instants, n - 2, n, *distance.shape))
    rows[:, -1, 0] = sine * (2.0 * cosine**2 - sine**2) * quick**2
    rows[:, -1, 1] = -3.0 * sine**2 * cosine * quick**2
    rows[:, -1, 2] = sine**2 * quick * (2.0 + 3.0 * age * quick * cosine)
    if bearings:
        rows[:, 0, 0] = -cosine * near
        rows[:, 0, 1] = sine * near
        rows[:, 0, 2] = -age * sine * near
        rows[:, 0, 3] = 1.0
    return rows


def _track(
    closest_approach: Array | float, along_track: Array | float, speed: Array | float, period: float
) -> tuple[Array, Array, Array]:
    """D, L and v, checked and broadcast."""
    require_positive("period", period)
    distance, along, fast = _finite(closest_approach=closest_approach, along_track=along_track, speed=speed)
    return distance, along, fast


def _finite(**values: Array | float) -> tuple[Array, ...]:
    """Named numbers, checked and broadcast."""
    given = {field: require_finite(field, value) for field, value in values.items()}
    try:
        return tuple(np.broadcast_arrays(*given.values()))
    except ValueError:
        shapes = ", ".join(f"{field} {value.shape}" for field, value in given.items())
        raise InputError(f"shapes {shapes} is not possible: must broadcast against each other") from None


def _sorted_ranges(distance: Array, along: Array, speed: Array, period: float, instants: int) -> Array:
    """Ranges at the latest instants ``(instants, …)``, nearest first."""
    offsets = np.stack([along - i * period * speed for i in range(instants)])
    ranges: Array = np.sort(np.hypot(distance, offsets), axis=0)
    return ranges


def _over(value: Array | float, distance: Array) -> Array:
    """``value / distance``, zero at a contact."""
    quotient = np.zeros(np.broadcast_shapes(np.shape(value), distance.shape))
    with np.errstate(over="ignore"):
        np.divide(value, distance, out=quotient, where=distance > _CONTACT)
    return quotient
