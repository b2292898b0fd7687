"""Throwing out what is too unlikely to be a measurement of the emitter.

The innovation y of a sensor with m scalars, expected with covariance S, is used only where

    yᵀ S⁻¹ y ≤ χ²_m(P),

which a consistent filter finds true with the probability P (Bar-Shalom, Li & Kirubarajan, *Estimation with
Applications*, 2.5.3 and 5.4.2). A gate believes the filter: one that has lost the emitter for good throws out the very
measurements that would put it right, and its covariance must grow before any comes in again.
"""

from __future__ import annotations

import math
from statistics import NormalDist
from typing import Any

import numpy as np

from passloc_env.arrays import Array, BoolArray
from passloc_env.fields import quantity
from passloc_env.linalg import cholesky_above, solve_lower, spaced, tree_sum
from passloc_env.sensor_suite import SensorSuite


def gate_probability() -> Any:
    """Declare the field of a tracker that says how wide its gate is."""
    doc = "chance that a measurement of the emitter passes the gate; 0 uses all"
    return quantity(doc, 0.0, at_least=0, below=1, plain=True, appended=True)


class Gate:
    """The gate of a filter, one threshold for each sensor.

    Args:
        probability: chance that a measurement of the emitter passes, above 0.
        suite: what is measured.
    """

    def __init__(self, probability: float, suite: SensorSuite) -> None:
        self._thresholds = [chi_square_quantile(probability, sensor.size) for sensor in suite.sensors]

    def passed(self, innovation: Array, covariance: Array, suite: SensorSuite) -> BoolArray:
        """Which innovations ``(m, …, N)`` are likely enough for their covariance ``(m, m, …, N)``, sensor by sensor.

        What is not a finite number passes: that the filter is broken must not stay hidden.
        """
        passed = np.ones_like(innovation, bool)
        floors = spaced(suite.noise_pivots, innovation.ndim)
        for rows, threshold in zip(suite.rows, self._thresholds, strict=True):
            lower = cholesky_above(covariance[rows, rows].copy(), floors[rows])
            whitened = solve_lower(lower, innovation[rows, None].copy())[:, 0]
            surprise = tree_sum(whitened * whitened)
            passed[rows] = ~((surprise > threshold) & np.isfinite(surprise))
        return passed


def gate_of(probability: float, suite: SensorSuite) -> Gate | None:
    """The gate that lets so many through; None with 0."""
    return Gate(probability, suite) if probability else None


def chi_square_quantile(probability: float, degrees: int) -> float:
    """What a chi-square variable stays below with a probability in (0, 1)."""
    if degrees == 1:
        return NormalDist().inv_cdf(0.5 + 0.5 * probability) ** 2
    low, high = 0.0, float(degrees)
    while chi_square_distribution(high, degrees) < probability:
        high *= 2.0
    while (middle := 0.5 * (low + high)) not in (low, high):
        if chi_square_distribution(middle, degrees) < probability:
            low = middle
        else:
            high = middle
    return high


def chi_square_distribution(value: float, degrees: int) -> float:
    """The distribution function of a chi-square variable; from one or two degrees of freedom upwards by parts."""
    half = 0.5 * value
    below = math.erf(math.sqrt(half)) if degrees % 2 else -math.expm1(-half)
    for done in range(2 - degrees % 2, degrees, 2):
        below -= math.exp(-half) * half ** (0.5 * done) / math.gamma(0.5 * done + 1.0)
    return below
