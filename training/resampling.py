"""Statistics of resamples that are seen piece by piece, so that no whole resample need be held.

Something is kept of each piece, and what was kept of all of them gives the statistic: to the last bit what NumPy says
of the whole resample.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple, Protocol

import numpy as np

from passloc_env.arrays import Array

PIECE = 1 << 16
"""Values in a piece at most: so few that they stay in a processor's cache."""

_STRAY = 6.0
"""How far from the middle a resampled median is looked for, in √n ranks: by Hoeffding's inequality it lies further away
with a chance of no more than 2 exp(−2 · 6²), once in 10³⁰."""


class Statistic(Protocol):
    """A statistic of resamples of some values."""

    values: Array
    """What is drawn from, ``(n, …)``."""

    def keep(self, piece: Array) -> Any:
        """What is kept of a piece ``(k, m, …)`` of ``k`` resamples."""
        ...

    def conclude(self, kept: list[Any]) -> Array:
        """The statistic ``(k,)`` from what was kept of the pieces, in their order."""
        ...


class Whole:
    """Any statistic, from all that was drawn.

    Args:
        values: what is drawn from, ``(n, …)``.
        statistic: called as ``statistic(resamples, axis=1)`` on ``(k, n, …)``.
    """

    def __init__(self, values: Array, statistic: Callable[..., Array]) -> None:
        self.values, self._statistic = values, statistic

    def keep(self, piece: Array) -> Array:
        """The piece itself."""
        return piece

    def conclude(self, kept: list[Array]) -> Array:
        """See :class:`Statistic`."""
        return self._statistic(kept[0] if len(kept) == 1 else np.concatenate(kept, axis=1), axis=1)


class Mean:
    """The mean of values ``(n,)``, from the sums of the pieces."""

    def __init__(self, values: Array) -> None:
        self.values = values

    def keep(self, piece: Array) -> Array:
        """The sum."""
        total: Array = piece.sum(axis=1)
        return total

    def conclude(self, kept: list[Array]) -> Array:
        """See :class:`Statistic`."""
        return _pairwise(iter(kept), len(self.values)) / len(self.values)


class RootMeanSquare(Mean):
    """``√mean(x²)`` of values ``(n,)``."""

    def __init__(self, values: Array) -> None:
        super().__init__(np.square(values))

    def conclude(self, kept: list[Array]) -> Array:
        """See :class:`Statistic`."""
        root: Array = np.sqrt(super().conclude(kept))
        return root


class Part(NamedTuple):
    """What a piece of a single resample tells of its median.

    Attributes:
        below: how many values lie too low to be it.
        near: those that may be.
    """

    below: int
    near: Array


class Median:
    """The median of values ``(n,)`` that are all numbers, one resample at a time, from those near the middle."""

    def __init__(self, values: Array) -> None:
        n = len(values)
        self.values, self._middle = values, ((n - 1) // 2, n // 2)
        stray = int(_STRAY * np.sqrt(n)) + 1
        ranks = max(0, self._middle[0] - stray), min(n - 1, self._middle[1] + stray)
        self._low, self._high = np.partition(values, ranks)[list(ranks)]

    def keep(self, piece: Array) -> Part:
        """See :class:`Part`."""
        values = piece[0]
        high_enough = values >= self._low
        return Part(len(values) - int(np.count_nonzero(high_enough)), values[high_enough & (values <= self._high)])

    def conclude(self, kept: list[Part]) -> Array:
        """See :class:`Statistic`."""
        near = np.concatenate([part.near for part in kept])
        ranks = np.array(self._middle) - sum(part.below for part in kept)
        return np.partition(near, ranks)[ranks].mean(keepdims=True)


def pieces(n: int) -> list[int]:
    """The sizes of the pieces of ``n`` values, cut as NumPy does where it adds them up in pairs of halves."""
    return [n] if n <= PIECE else [size for half in _halves(n) for size in pieces(half)]


def _pairwise(sums: Iterator[Array], n: int) -> Array:
    """The sum of ``n`` values from those of their :func:`pieces`, in the order in which NumPy adds."""
    if n <= PIECE:
        return next(sums)
    first, second = (_pairwise(sums, half) for half in _halves(n))
    return first + second


def _halves(n: int) -> tuple[int, int]:
    first = n // 2 - n // 2 % 8
    return first, n - first
