"""Observability read off the bearings alone: the corollaries of papers 000 and 003, corrected, as predicates.

They speak of noise-free bearings; the emitter moves as the name says and the stations stand still. Lines of sight are
compared modulo half a turn: flying through a station turns the bearing around, but not the line that it lies on.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from passloc_env.angles import wrap
from passloc_env.arrays import Array, BoolArray
from passloc_env.checks import require_exactly, require_positive, require_shape
from passloc_env.errors import InputError

_INSTANTS = 5
"""Instants that a record needs at least."""

_TOLERANCE = 1e-9
"""Radians: a thousand times the rounding of a bearing after many turns, a millionth of what any sensor resolves."""


def constant_acceleration_observable(bearings: ArrayLike, tolerance: float = _TOLERANCE) -> BoolArray:
    """Whether bearing and Doppler at one station determine an emitter of constant acceleration.

    They do iff the line of sight is not constant (paper 000, corollary 1), whether or not the acceleration and the
    carrier are known.

    Args:
        bearings: ``(K, N)``, rad; five instants or more.
        tolerance: directions closer than this count as equal, rad.

    Returns:
        ``(N,)``.

    Raises:
        InputError: bearings that are not finite or have another shape, fewer than five instants.
    """
    return _departs(_record("bearings", bearings), tolerance)


def coordinated_turn_observable(
    bearings: ArrayLike, turn_rate: ArrayLike, period: float, tolerance: float = _TOLERANCE
) -> BoolArray:
    """Whether bearing and Doppler at one station determine an emitter in a coordinated turn of known rate.

    They do not iff the line of sight turns at the emitter's own rate, that is, iff the emitter circles the station
    (paper 000, corollary 2, whose printed sign belongs to counter-clockwise bearings). The corollary overlooks an
    emitter at rest, whose constant bearing differs from the turn rate and yet hides the range; it is unobservable too.

    Args:
        bearings: ``(K, N)``, rad; five instants or more.
        turn_rate: of the emitter, rad/s, positive to starboard; a number or ``(N,)``.
        period: time between bearings, s.
        tolerance: directions closer than this count as equal, rad.

    Returns:
        ``(N,)``.

    Raises:
        InputError: bearings or turn rates that are not finite or have another shape, fewer than five instants, a period
            that is not finite and positive.
    """
    seen = _record("bearings", bearings)
    require_positive("period", period)
    rate = require_exactly("turn_rate", turn_rate, (), (1,), seen.shape[1:])
    time = period * np.arange(len(seen))[:, None]
    return _departs(seen - rate * time, tolerance) & _departs(seen, tolerance)


def dual_array_observable(first: ArrayLike, second: ArrayLike, tolerance: float = _TOLERANCE) -> BoolArray:
    """Whether the bearings at two stations determine an emitter of constant acceleration.

    They do not iff the emitter stays on the baseline throughout, where both lines of sight are the baseline itself.
    Anywhere else they cross in the emitter, and paper 003's further condition (that the bearing at the first array be
    constant, sec. 2.2) adds nothing: on the baseline it is, and off the baseline it does not matter. Nor does
    frequency.

    Args:
        first: bearings at one station ``(K, N)``, rad; five instants or more, for a parabola can meet the baseline
            twice and three fixes must remain.
        second: bearings at the other station, alike.
        tolerance: directions closer than this count as equal, rad.

    Returns:
        ``(N,)``.

    Raises:
        InputError: bearings that are not finite, or whose shapes differ, fewer than five instants.
    """
    one, other = _record("first", first), _record("second", second)
    if one.shape != other.shape:
        raise InputError(f"second of shape {other.shape} is not possible: must be {one.shape}, as the first")
    return np.logical_or.reduce(_between_lines(other, one) > tolerance, axis=0)


def _record(field: str, bearings: ArrayLike) -> Array:
    """A record of bearings ``(K, N)``; refuses whatever is none, or too short."""
    record = require_shape(field, bearings, 2, "instants and environments")
    if len(record) < _INSTANTS:
        raise InputError(f"{field} of {len(record)} instants is not possible: must be at least {_INSTANTS}")
    return record


def _between_lines(first: Array, second: Array) -> Array:
    """Angle between undirected lines of the given directions, ``[0, π/2]``."""
    angle: Array = np.abs(0.5 * wrap(2.0 * (first - second)))
    return angle


def _departs(directions: Array, tolerance: float) -> BoolArray:
    """Whether lines ``(K, N)`` ever leave the one they start on, ``(N,)``."""
    return np.logical_or.reduce(_between_lines(directions, directions[0]) > tolerance, axis=0)
