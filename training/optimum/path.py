"""The path that a turn-limited platform flies under one turn per decision, differentiable in the turns."""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from torch import Tensor


class Path(NamedTuple):
    """Where the observer is at ``S`` instants of each of ``D`` decisions, ``(2, D · S, B)`` each."""

    position: Tensor
    forward: Tensor


class Flyer(NamedTuple):
    """An observer at the start: ``position (2, B)``, and ``heading``, ``speed``, ``max_turn_rate`` ``(B,)``."""

    position: Tensor
    heading: Tensor
    speed: Tensor
    max_turn_rate: Tensor


def headings(flyer: Flyer, turns: Tensor) -> Tensor:
    """The heading set-point of each decision ``(D, B)``, not wrapped."""
    return flyer.heading + torch.cumsum(turns, 0)


def fly(flyer: Flyer, turns: Tensor, instants: Tensor) -> Path:
    """The path of :meth:`passloc_env.platforms.TurnLimitedPlatform.move`, in closed form.

    Clipping the turn in each sensor step amounts to one arc at the largest rate, as long as the turn takes, then a
    straight line. The chord of an arc that turns by ``φ`` in ``τ`` seconds is ``τ sinc(φ/2)`` long, in units of the
    speed, and points along the mid-arc heading.

    Args:
        flyer: the observer at the start.
        turns: by how much each decision turns ``(D, B)``, rad, no more than the platform can in one interval.
        instants: seconds after the decision ``(S,)``, the last one the next decision.
    """
    after = headings(flyer, turns)
    before = (after - turns)[:, None]
    wanted, time = turns[:, None], instants[:, None]
    size = torch.minimum(wanted.abs(), flyer.max_turn_rate * time)
    arc = torch.sign(wanted) * size
    turning = size / flyer.max_turn_rate

    middle, end = before + 0.5 * arc, before + arc
    chord = turning * torch.sinc(arc * (0.5 / math.pi))
    forward = torch.stack([end.sin(), end.cos()])
    moved = flyer.speed * (chord * torch.stack([middle.sin(), middle.cos()]) + (time - turning) * forward)
    legs = moved[:, :, -1]
    starts = flyer.position[:, None] + torch.cumsum(legs, 1) - legs
    position = starts[:, :, None] + moved
    return Path(position.flatten(1, 2), forward.flatten(1, 2))
