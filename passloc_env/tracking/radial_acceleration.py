"""A straight track from three radial accelerations, in closed form.

``a = D² v² / r³`` (paper 002, eq. 4), so ``a^{−2/3} = r²/κ`` with ``κ = (|D| v)^{4/3}`` is a quadratic in time,

    a^{−2/3} = A t² + B t + C,   A = v²/κ,   B = 2 L v/κ,   C = (D² + L²)/κ,   AC − B²/4 = (|D| v)^{−2/3},

which three instants determine: this is how they determine range and speed (paper 002, conclusion 1).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from passloc_env.arrays import Array, BoolArray, rows
from passloc_env.checks import as_floats, require_positive
from passloc_env.errors import InputError

_ROUNDING = 4.0 * float(np.finfo(float).eps)
"""Share of its terms below which a difference is rounding."""


class TrackSolution(NamedTuple):
    """A straight track at the latest instant.

    Attributes:
        state: distance of the closest approach ``|D|`` (m), distance travelled since ``L`` (m) and speed ``v`` (m/s),
            ``(3, N)``; zero where not sound.
        sound: whether the accelerations belong to a straight track that does not point at the observer ``(N,)``.
    """

    state: Array
    sound: BoolArray


def solve_track(accelerations: ArrayLike, period: float) -> TrackSolution:
    """The straight track with three given radial accelerations.

    Neither the side on which the track passes (the sign of D) nor its direction can be told. No solution is sound where
    an acceleration is not positive and finite, or where ``a^{−2/3}`` does not curve upwards and stay above zero: noise
    larger than the curvature, a radial track or an emitter at rest.

    The curvature is a second difference, so relative errors of the accelerations come out some ``(r/vT)²`` times
    larger: a period should be as long as the track allows.

    Args:
        accelerations: ``(3, N)``, m/s², oldest first.
        period: time between them, s.

    Raises:
        InputError: not three accelerations, a period that is not finite and positive.
    """
    radial = as_floats("accelerations", accelerations)
    if radial.ndim != 2 or len(radial) != 3:
        raise InputError(f"accelerations of shape {radial.shape} is not possible: must be (3, environments)")
    require_positive("period", period)

    positive = np.logical_and.reduce(radial > 0.0, axis=0)
    radial = np.where(positive, radial, 1.0)
    with np.errstate(over="ignore", divide="ignore", invalid="ignore"):
        state, curved = _straight_track(radial, period)
        sound = positive & curved & np.isfinite(state).all(axis=0)
    return TrackSolution(np.where(sound, state, 0.0), sound)


def _straight_track(accelerations: Array, period: float) -> tuple[Array, BoolArray]:
    """State of three positive accelerations, and whether their ``a^{−2/3}`` curves as that of a track does.

    Time is counted in periods and acceleration in the latest one, so that C = 1.
    """
    latest = accelerations[2]
    oldest, previous = (accelerations[:2] / latest) ** (-2.0 / 3.0)
    curvature = 0.5 * (oldest - 2.0 * previous + 1.0)
    slope = 0.5 * (oldest - 4.0 * previous + 3.0)
    closest = curvature - 0.25 * slope**2
    curved = closest > _ROUNDING * (oldest + 2.0 * previous + 1.0) * (1.0 + np.abs(slope))
    root, depth = np.sqrt(np.where(curved, curvature, 1.0)), np.where(curved, closest, 1.0)
    unit = latest * period
    state = rows(
        unit * period / (root * np.sqrt(depth)), unit * period * slope / (2.0 * depth * root), unit * root / depth
    )
    return state, curved
