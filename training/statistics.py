"""Intervals: paired bootstrap over episodes, and Wilson's for rates."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from passloc_env.arrays import Array, BoolArray
from training.resampling import Mean, Median, RootMeanSquare, Statistic, Whole, pieces

RESAMPLES = 2000
_SEED = 20_000
_HELD = 1 << 20
"""Values that may be held at once to draw from, or those of one statistic where these are more: where they outgrow a
processor's cache nothing is gained by drawing once for several."""
_DRAWN = 1 << 13
"""Episodes that are drawn at once, as whole resamples, where these are so small; no more than a piece."""

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


class Asked(NamedTuple):
    """Something to estimate.

    Attributes:
        values: gives per-episode values ``(episodes, …)``; called when they are needed, and not held for longer.
        statistic: as :meth:`Bootstrap.estimate` takes it.
    """

    values: Callable[[], Array]
    statistic: Callable[..., Array] = np.mean


class Bootstrap:
    """Resamples of the same episodes for every policy, so that comparisons stay paired.

    Args:
        episodes: how many episodes there are.
        resamples: how many resamples are drawn.
    """

    def __init__(self, episodes: int, resamples: int = RESAMPLES) -> None:
        self._episodes, self._resamples = episodes, resamples

    def estimate(self, values: Array, statistic: Callable[..., Array] = np.mean) -> Estimate:
        """A statistic of per-episode values ``(episodes, …)`` with its percentile interval.

        ``statistic(values, axis=…)`` is called on the values and on resamples ``(k, episodes, …)``, some at a time.
        """
        (estimate,) = self.estimates([Asked(lambda: values, statistic)])
        return estimate

    def estimates(self, asked: Sequence[Asked]) -> list[Estimate]:
        """As :meth:`estimate`, of several at once: resamples are drawn anew only where not all values can be held."""
        together = max(1, _HELD // self._episodes)
        groups = [asked[first : first + together] for first in range(0, len(asked), together)]
        return [estimate for group in groups for estimate in self._group(group)]

    def _group(self, group: Sequence[Asked]) -> list[Estimate]:
        values, statistics = zip(*(self._begun(each.values(), each.statistic) for each in group), strict=True)
        resampled = [np.concatenate(parts) for parts in zip(*self._resampled(statistics), strict=True)]
        limits = [map(float, np.percentile(each, [2.5, 97.5])) for each in resampled]
        return [Estimate(value, *between) for value, between in zip(values, limits, strict=True)]

    def _begun(self, values: Array, statistic: Callable[..., Array]) -> tuple[float, Statistic]:
        """The statistic, and how that of resamples is found: piece by piece where they are large and it can be."""
        known = _PIECEWISE.get(statistic)
        plain = values.ndim == 1 and values.dtype == float and not np.isnan(values).any()
        seen = known(values) if known and plain and self._episodes > _DRAWN else Whole(values, statistic)
        return float(statistic(values, axis=0)), seen

    def _resampled(self, statistics: Sequence[Statistic]) -> Iterator[list[Array]]:
        """Each statistic ``(k,)`` of some resamples after others, always the same ones."""
        rng = np.random.default_rng(_SEED)
        rows, sizes = max(1, _DRAWN // self._episodes), pieces(self._episodes)
        for first in range(0, self._resamples, rows):
            kept: list[list[Any]] = [[] for _ in statistics]
            for size in sizes:
                drawn = rng.integers(self._episodes, size=(min(rows, self._resamples - first), size))
                for statistic, parts in zip(statistics, kept, strict=True):
                    parts.append(statistic.keep(statistic.values.take(drawn, axis=0, mode="clip")))
            yield [statistic.conclude(parts) for statistic, parts in zip(statistics, kept, strict=True)]


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


_PIECEWISE: dict[Callable[..., Array], Callable[[Array], Statistic]] = {
    np.mean: Mean,
    np.median: Median,
    root_mean_square: RootMeanSquare,
}
"""The statistics that need no whole resample."""


def chi_square_band(degrees: int) -> tuple[float, float]:
    """95 % band of a chi-square variable over its degrees of freedom (Wilson–Hilferty), e.g. for ANEES per state."""
    spread = math.sqrt(2.0 / (9.0 * degrees))
    return tuple((1.0 - 2.0 / (9.0 * degrees) + sign * _NORMAL_975 * spread) ** 3 for sign in (-1.0, 1.0))  # type: ignore[return-value]
