"""The posterior Cramér–Rao bound along a path, differentiable in the turns that make the path.

The recursion is that of :mod:`passloc_env.information` in covariance form, ``C ← F C Fᵀ + Q`` and then
``C ← C − C h hᵀ C / (hᵀ C h + σ²)`` for each scalar, which equals the joint update because the scalars' errors are
uncorrelated.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import torch
from torch import Tensor

from training.optimum.future import Future
from training.optimum.jacobians import Look, jacobians
from training.optimum.path import Flyer, Path, fly

_TINY = 1e-12
"""m²: rounding must never make a variance negative."""


class Value(NamedTuple):
    """What turns are worth: the objective ``(B,)``, and the true range at each instant ``(K, B)``, m."""

    objective: Tensor
    range: Tensor


class Problem:
    """The bound of a batch of episodes as a function of the observer's turns.

    Args:
        future: the episodes, one per column.
        objective: name of an objective, see :data:`OBJECTIVES`.
        lumped: count the measurements of a decision as one, as good as all of them together, made at its end. For
            searching: as many times faster as there are measurements in a decision, and a little off.
    """

    def __init__(self, future: Future, objective: str = "log_range_bound", lumped: bool = False) -> None:
        self.future = future
        episode = future.scenario.episode
        stride = episode.decision_every if lumped else 1
        self._objective = OBJECTIVES[objective]
        self._instants = episode.period * torch.arange(stride, episode.decision_every + 1, stride, dtype=torch.float64)
        self._truth = torch.from_numpy(future.truth[:, stride - 1 :: stride])
        self._sigmas = torch.from_numpy(future.sigmas) / stride**0.5
        self._prior = torch.from_numpy(future.prior)
        self._advance, self._spread = _strides(future, stride)
        starts = (future.position, future.heading, future.speed, future.max_turn_rate)
        self.flyer = Flyer(*(torch.from_numpy(values) for values in starts))

    def __call__(self, turns: Tensor) -> Value:
        """What turns ``(D, B)`` are worth."""
        look = self._look(turns)
        rows = [row / sigma for row, sigma in zip(jacobians(self.future.sensors, look), self._sigmas, strict=True)]
        covariance = self._recurse(rows)
        distance = (look.offset * look.offset).sum(0).sqrt()
        return Value(self._objective(covariance, look.offset / distance, distance), distance)

    def path(self, turns: Tensor) -> Path:
        """The path that turns ``(D, B)`` make."""
        return fly(self.flyer, turns, self._instants)

    def _look(self, turns: Tensor) -> Look:
        path, layout = self.path(turns), self.future.layout
        offset = self._truth[layout.position] - path.position
        velocity = self._truth[layout.velocity] - self.flyer.speed * path.forward
        return Look(offset, velocity, path.forward, self._truth, layout)

    def _recurse(self, rows: list[Tensor]) -> Tensor:
        """The position block of the bound after each measurement ``(K, 2, 2, B)``, from whitened ``h (w, K, B)``."""
        n, columns = self._prior.shape[0], self._prior.shape[-1]
        covariance, blocks = self._prior, []
        for scalars in zip(*(row.unbind(1) for row in rows), strict=True):
            moved = torch.addmm(self._spread, self._advance, covariance.reshape(n * n, columns))
            covariance = moved.reshape(n, n, columns)
            for scalar in scalars:
                width = len(scalar)
                gain = (covariance[:, :width] * scalar).sum(1)
                variance = 1.0 + (gain[:width] * scalar).sum(0)
                covariance = covariance - gain[:, None] * (gain / variance)
            blocks.append(covariance[:2, :2])
        return torch.stack(blocks)


def _strides(future: Future, stride: int) -> tuple[Tensor, Tensor]:
    """``F ⊗ F`` and ``Q``, as a column, of several sensor steps together: ``vec(F C Fᵀ) = (F ⊗ F) vec C``."""
    step = torch.from_numpy(future.transition)
    n = len(step)
    noise = torch.from_numpy(future.process_noise).reshape(n * n, -1)
    one = torch.kron(step, step)
    together, spread = one, noise
    for _ in range(stride - 1):
        together, spread = one @ together, one @ spread + noise
    return together, spread


def _log_range_bound(blocks: Tensor, towards: Tensor, distance: Tensor) -> Tensor:
    """Mean over time of ``ln(σ_r / r)``."""
    east, north = towards
    variance = east * east * blocks[:, 0, 0] + 2.0 * east * north * blocks[:, 0, 1] + north * north * blocks[:, 1, 1]
    return (0.5 * variance.clamp(min=_TINY).log() - distance.log()).mean(0)


def _end_position_bound(blocks: Tensor, towards: Tensor, distance: Tensor) -> Tensor:
    """``ln √(tr C)`` of the position at the end, m."""
    return 0.5 * (blocks[-1, 0, 0] + blocks[-1, 1, 1]).log()


OBJECTIVES: dict[str, Callable[[Tensor, Tensor, Tensor], Tensor]] = {
    "log_range_bound": _log_range_bound,
    "end_position_bound": _end_position_bound,
}
"""What can be minimised, by the name of the score in :class:`training.episodes.Scores`, the second as its logarithm."""
