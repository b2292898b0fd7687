"""Beats: many pulses reduced to one least-squares line, evaluated where its noise is least.

A line through K values a spacing Δt apart has, per unit variance of a pulse,

    var(rate) = 12 / (K (K² − 1) Δt²),   var(value at mid-beat) = 1/K,   both uncorrelated,

from which every other instant follows. At the first pulse it is ``2(2K − 1) / (K (K + 1))``, nearly four times as much
as at mid-beat, and correlated with the rate by ``−6 / (K (K + 1) Δt)`` (paper 001, its preprocessing of a beat). The
line is the efficient estimate under white noise: what is lost at the first pulse is lost by asking there.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from passloc_env.arrays import Array
from passloc_env.checks import as_floats, require_count, require_finite, require_positive
from passloc_env.errors import InputError
from passloc_env.linalg import tree_sum


class LineFit(NamedTuple):
    """The line through the pulses of a beat.

    Attributes:
        start: value at the first pulse ``(…, N)``.
        middle: value at mid-beat ``(…, N)``.
        rate: change per second ``(…, N)``.
        start_covariance: of (start, rate) per unit variance of a pulse ``(2, 2)``.
        middle_covariance: of (middle, rate), alike; diagonal.
    """

    start: Array
    middle: Array
    rate: Array
    start_covariance: Array
    middle_covariance: Array


def line_fit(values: ArrayLike, spacing: float) -> LineFit:
    """The least-squares line through the equally spaced pulses of a beat.

    Args:
        values: ``(…, K, N)``, pulses in order of time; leading axes are further measurements. Angles must be continuous
            over the beat, not wrapped.
        spacing: time between pulses, s.

    Raises:
        InputError: fewer than two pulses, values that are not finite, a spacing that is not finite and positive.
    """
    beat = as_floats("values", values)
    if beat.ndim < 2:
        raise InputError(f"values of shape {beat.shape} is not possible: must be (…, pulses, environments)")
    pulses = beat.shape[-2]
    start_covariance = line_covariance(pulses, spacing)
    require_finite("values", beat)

    # Measured from the first pulse, large values with small changes lose no digits.
    first = beat[..., 0, :]
    changes = np.moveaxis(beat, -2, 0) - first
    offsets = np.arange(pulses) - 0.5 * (pulses - 1)
    slope = tree_sum(offsets.reshape(-1, *(1,) * first.ndim) * changes) * (12.0 / (pulses * (pulses**2 - 1.0)))
    mean = tree_sum(changes) / pulses
    return LineFit(
        start=first + (mean - 0.5 * (pulses - 1) * slope),
        middle=first + mean,
        rate=slope / spacing,
        start_covariance=start_covariance,
        middle_covariance=line_covariance(pulses, spacing, at=0.5),
    )


def line_covariance(pulses: int, spacing: float, at: float = 0.0) -> Array:
    """Covariance of a line's (value, rate) per unit variance of a pulse.

    Args:
        pulses: K, two or more.
        spacing: Δt between pulses, s.
        at: where in the beat the value is taken: 0 at the first pulse, ½ at mid-beat, 1 at the last pulse.

    Returns:
        ``(2, 2)``; in units of 1, 1/s and 1/s².

    Raises:
        InputError: fewer than two pulses or not a whole number of them, a spacing that is not finite and positive, an
            instant that is not finite.
    """
    require_count("pulses", pulses, at_least=2)
    require_positive("spacing", spacing)
    require_finite("at", at)
    rate = 12.0 / (pulses * (pulses**2 - 1.0) * spacing**2)
    lever = (at - 0.5) * (pulses - 1) * spacing
    return np.array([[1.0 / pulses + lever**2 * rate, lever * rate], [lever * rate, rate]])


def independent_offset(pulses: int, spacing: float) -> float:
    """How far from mid-beat, s, the two values of a line lie whose errors are uncorrelated: ``Δt √((K² − 1)/12)``.

    Each has the variance 2/K of a pulse, and together they say all that value and rate say, so that a tracker can take
    a whole line as two looks.

    Raises:
        InputError: fewer than two pulses or not a whole number of them, a spacing that is not finite and positive.
    """
    covariance = line_covariance(pulses, spacing, at=0.5)
    return math.sqrt(covariance[0, 0] / covariance[1, 1])


def start_value_loss(pulses: int) -> float:
    """Standard deviation of a line's value at the first pulse over that at mid-beat: ``√(2(2K − 1)/(K + 1))``.

    Raises:
        InputError: fewer than two pulses, or not a whole number of them.
    """
    require_count("pulses", pulses, at_least=2)
    return math.sqrt(2.0 * (2 * pulses - 1) / (pulses + 1))
