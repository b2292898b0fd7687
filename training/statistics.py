"""Intervals: paired bootstrap over episodes, and Wilson's for rates."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from passloc_env.arrays import Array, BoolArray, IntArray

RESAMPLES = 2000
_SEED = 20_000
_AT_ONCE = 1 << 20
"""Values resampled at once: memory does not grow with the number of episodes."""

_NORMAL_975 = 1.959963984540054


@dataclass(frozen=True)
class Estimate:
    """A value with its 95 % interval."""

    value: float
    low: float
    high: float

    def scaled(self, scale: float) -> Estimate:
        """The same in another unit."""
        return Estimate(scale * self.value, scale * self.low, scale * self.high)


class Bootstrap:
    """Resamples of the same episodes for every policy, so that comparisons stay paired.

    Args:
        episodes: how many episodes there are.
        resamples: how many resamples are drawn.
    """

    def __init__(self, episodes: int, resamples: int = RESAMPLES) -> None:
        self._episodes, self._resamples = episodes, resamples

    def estimate(self, values: Array, statistic: Callable[..., Array] = np.mean) -> Estimate:
        """A statistic of per-episode values ``(episodes,)`` with its percentile interval.

        ``statistic(values, axis=…)`` is called on the values and on resamples ``(k, episodes)``, some at a time.
        """
        resampled = np.concatenate([statistic(values[indices], axis=1) for indices in self._drawn()])
        low, high = np.percentile(resampled, [2.5, 97.5])
        return Estimate(float(statistic(values, axis=0)), float(low), float(high))

    def _drawn(self) -> Iterator[IntArray]:
        """Episodes of the resamples ``(k, episodes)``, always the same ones, some resamples at a time."""
        rng = np.random.default_rng(_SEED)
        rows = max(1, _AT_ONCE // self._episodes)
        for first in range(0, self._resamples, rows):
            yield rng.integers(self._episodes, size=(min(rows, self._resamples - first), self._episodes))


def rate(events: BoolArray) -> Estimate:
    """The share of episodes in which something happened, with Wilson's score interval.

    Unlike the bootstrap it does not collapse when nothing happened at all.
    """
    n, share, z = len(events), float(np.mean(events)), _NORMAL_975
    centre = (share + z * z / (2 * n)) / (1 + z * z / n)
    half = z / (1 + z * z / n) * math.sqrt(share * (1 - share) / n + z * z / (4 * n * n))
    return Estimate(share, min(share, max(0.0, centre - half)), max(share, min(1.0, centre + half)))


def root_mean_square(values: Array, axis: int = 0) -> Array:
    """``√mean(x²)``."""
    result: Array = np.sqrt(np.mean(np.square(values), axis=axis))
    return result


def chi_square_band(degrees: int) -> tuple[float, float]:
    """95 % band of a chi-square variable over its degrees of freedom (Wilson–Hilferty), e.g. for ANEES per state."""
    spread = math.sqrt(2.0 / (9.0 * degrees))
    return tuple((1.0 - 2.0 / (9.0 * degrees) + sign * _NORMAL_975 * spread) ** 3 for sign in (-1.0, 1.0))  # type: ignore[return-value]
