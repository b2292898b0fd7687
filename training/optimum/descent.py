"""Descending from given turns: Adam within the limits of the platform, the keep-out as a penalty that stiffens."""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor

from training.optimum.bound import Problem, Value

_MARGIN = 0.002
"""Share of min_range by which the penalty begins outside of it, so that what it yields is still legal."""

_STIFF = 300.0
"""The penalty's weight at the end: large against what a share of min_range is worth in a mean of logarithms."""

_LAST_STEP = 0.006
"""Adam's last step, in the units of the first."""

_MEMORY = (0.8, 0.9)
"""Adam's decay rates: short, for the landscape changes with the penalty."""

_ILLEGAL = 1e3
"""Added to what enters the keep-out, so that anything legal is better."""


class Found(NamedTuple):
    """The best turns ``(D, B)``, their objective ``(B,)``, and whether they keep out of min_range ``(B,)``."""

    turns: Tensor
    objective: Tensor
    legal: Tensor


def judge(problem: Problem, turns: Tensor) -> Found:
    """Turns as they are."""
    with torch.no_grad():
        value = problem(turns)
        return Found(turns, value.objective, _legal(problem, value))


def descend(problem: Problem, turns: Tensor, iterations: int, step: float, soft: float = _STIFF) -> Found:
    """The best of what Adam (Kingma & Ba 2015) meets on its way from ``turns (D, B)``; columns do not mix.

    Step and softness fade geometrically: at first a path may cut through the keep-out and come out at its other side.
    Turns beyond what the platform can do are cut back to it. The best paths turn at the largest rate much of the time,
    which a squashing function would never quite reach.

    Args:
        problem: what the turns are worth.
        turns: where to begin.
        iterations: how often the gradient is followed.
        step: Adam's first step, as a share of the largest turn; of a radian where that is unlimited.
        soft: the penalty's weight at the beginning.
    """
    limit = torch.from_numpy(problem.future.largest_turn)
    scale = torch.where(limit.isinf(), torch.ones_like(limit), limit)
    control = (turns / scale).detach().requires_grad_()
    optimiser = torch.optim.Adam([control], lr=step, betas=_MEMORY)
    best, found = torch.full_like(limit, math.inf), judge(problem, turns)
    for iteration in range(iterations):
        share = iteration / max(iterations - 1, 1)
        optimiser.param_groups[0]["lr"] = step * (_LAST_STEP / step) ** share
        optimiser.zero_grad()
        value = problem(control * scale)
        intrusion = _intrusion(problem, value)
        (value.objective + soft * (_STIFF / soft) ** share * intrusion).sum().backward()
        with torch.no_grad():
            legal = _legal(problem, value)
            rank = value.objective + torch.where(legal, 0.0, _ILLEGAL + _STIFF * intrusion)
            better = rank < best
            best = torch.where(better, rank, best)
            now = Found(control * scale, value.objective, legal)
            found = Found(*(torch.where(better, new, old) for new, old in zip(now, found, strict=True)))
        optimiser.step()
        with torch.no_grad():
            control.clamp_(-limit / scale, limit / scale)
    return Found(*(part.detach() for part in found))


def _intrusion(problem: Problem, value: Value) -> Tensor:
    """``Σ depth²`` over the instants within min_range and its margin, the depth as a share of min_range."""
    closest = problem.future.scenario.episode.min_range
    if closest == 0.0:
        return torch.zeros_like(value.objective)
    depth = (1.0 + _MARGIN - value.range / closest).clamp(min=0.0)
    return (depth * depth).sum(0)


def _legal(problem: Problem, value: Value) -> Tensor:
    return (value.range >= problem.future.scenario.episode.min_range).all(0)
