"""What a forecast is worth: information about the emitter, and distance kept from it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from agents.forecast import Look
from passloc_env.arrays import Array
from passloc_env.information import sigma_along
from passloc_env.linalg import cholesky, diagonal, log_determinant, tree_sum
from passloc_env.metrics import log_range_bound


def range_bound(look: Look) -> Array:
    """``ln(σ_r / r)`` from the own ship: the headline of every table, forecast."""
    sightline = look.scene.sightline(look.own_ship)
    return log_range_bound(sigma_along(_position(look), sightline.direction), sightline.range)


def a_optimal(look: Look) -> Array:
    """``½ ln tr P`` of the position: A-optimality (Atkinson & Donev, *Optimum Experimental Designs*, ch. 10)."""
    return 0.5 * np.log(np.maximum(tree_sum(diagonal(_position(look)).copy()), 1e-12))


def d_optimal(look: Look) -> Array:
    """``½ ln det P`` of the whole state, so that least is most ``ln det`` of the information: D-optimality."""
    return 0.5 * log_determinant(cholesky(look.covariance).lower)


OBJECTIVES: dict[str, Callable[[Look], Array]] = {"range": range_bound, "A": a_optimal, "D": d_optimal}
"""What may be minimised, by name."""

SPANS = ("mean", "end")
"""When it counts: on average over the horizon, or at its end."""


@dataclass(frozen=True)
class Criterion:
    """The cost of a plan: an objective, and a penalty where it may come too close.

    Args:
        objective: one of :data:`OBJECTIVES`.
        span: one of :data:`SPANS`.
        margin: a commanded platform is too close where its forecast range, less that many standard deviations, is
            below the minimum range.
        caution: decisions over which the standard deviation is the one without further measurements: how sharp they
            will be is known beforehand, not what they will tell, and a platform that turns slowly must avoid now what
            it may learn too late. Beyond, there is time.
        weight: cost of being too close by the whole minimum range, all the time.
    """

    objective: str = "range"
    span: str = "mean"
    margin: float = 1.5
    caution: float = 25.0
    weight: float = 100.0

    def cost(self, looks: Iterator[Look], commanded: tuple[int, ...], min_range: float) -> Array:
        """The cost ``(N,)`` of what the looks show; lower is better, infinite where it is no number."""
        total: Array | float = 0.0
        last: Array | float = 0.0
        trespass: Array | float = 0.0
        steps = 0
        for look in looks:
            steps += look.steps
            last = OBJECTIVES[self.objective](look)
            total = total + look.steps * last
            if min_range > 0.0:
                trespass = trespass + look.steps * self._trespass(look, commanded, min_range)
        cost = (last if self.span == "end" else total / steps) + self.weight * trespass / steps
        return np.where(np.isnan(cost), np.inf, cost)

    def _trespass(self, look: Look, commanded: tuple[int, ...], min_range: float) -> Array | float:
        """How far the riskiest platform may be inside the minimum range, as a share of it ``(N,)``."""
        covariance = look.unheard if look.decision <= self.caution else look.covariance
        position = look.scene.layout.position
        worst: Array | float = 0.0
        for platform in commanded:
            sightline = look.scene.sightline(platform)
            closest = sightline.range - self.margin * sigma_along(covariance[position, position], sightline.direction)
            worst = np.maximum(worst, 1.0 - closest / min_range)
        return worst


def _position(look: Look) -> Array:
    """The position block of the covariance ``(d, d, N)``, a view."""
    block = look.scene.layout.position
    return look.covariance[block, block]
