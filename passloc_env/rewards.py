"""Named reward terms, each evaluated after every sensor step on the true geometry.

``log det P`` of the tracker alone would reward an overconfident filter, so information and error are always those of
the truth. A decision's reward is the mean over its sensor steps of ``Σ weight · term``; ``info["reward_terms"]``
carries each unweighted mean by name.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from passloc_env.arrays import Array, BoolArray, zeros
from passloc_env.component import Component
from passloc_env.fields import abstract, quantity
from passloc_env.information import Information, sigma_along
from passloc_env.layout import StateLayout
from passloc_env.lazy import lazy
from passloc_env.linalg import cholesky, inner, log_determinant
from passloc_env.metrics import log_range_bound, nees, relative_range_error, root_trace
from passloc_env.sightline import Scene, distance


class Outcome:
    """What one sensor step came to, for rewards, metrics and diagnostics; every quantity is computed on first use.

    Attributes:
        scene: the true emitter seen from the true poses.
        own_ship: index of the platform from which range and line of sight are taken.
        commanded: the platforms that must keep away from the emitter.
        mean, covariance: the tracker's belief in ``layout``.
        information: the bound.
        action: the action in force ``(a, N)``.
        min_range: the keep-out radius, m.
        last: whether this was the episode's last measurement ``(N,)``.
    """

    def __init__(
        self,
        scene: Scene,
        own_ship: int,
        commanded: tuple[int, ...],
        mean: Array,
        covariance: Array,
        layout: StateLayout,
        information: Information,
        action: Array,
        min_range: float,
        last: BoolArray,
    ) -> None:
        self.scene, self.pose = scene, scene.poses[own_ship]
        self._sightline, self._commanded = scene.sightline(own_ship), commanded
        self.mean, self.covariance, self.layout = mean, covariance, layout
        self.information, self.action, self.min_range, self.last = information, action, min_range, last

    @property
    def range(self) -> Array:
        """True range ``(N,)``, m."""
        return self._sightline.range

    @lazy
    def closest(self) -> Array:
        """True range of the nearest commanded platform ``(N,)``, m."""
        nearest, *others = (self.scene.sightline(platform).range for platform in self._commanded)
        for other in others:
            nearest = np.minimum(nearest, other)
        return nearest

    @lazy
    def range_sigma(self) -> Array:
        """Posterior Cramér–Rao bound on the range, ``√(uᵀ C u)`` along the true line of sight ``(N,)``, m."""
        position = self.information.dynamics.layout.position
        return sigma_along(self.information.bound[position, position], self._sightline.direction)

    @lazy
    def log_range_bound(self) -> Array:
        """``ln(σ_r / r)``, ``(N,)``."""
        return log_range_bound(self.range_sigma, self.range)

    @lazy
    def position_error(self) -> Array:
        """Estimated minus true position ``(d, N)``, m."""
        return self.mean[self.layout.position] - self.scene.state[self.scene.layout.position]

    @lazy
    def relative_range_error(self) -> Array:
        """Position error over true range ``(N,)`` (paper 000, eq. 26)."""
        return relative_range_error(self.position_error, self.range)

    @lazy
    def nees(self) -> Array:
        """Normalised estimation error squared over the states that truth and tracker share ``(N,)``."""
        shared = self.layout.shared_rows(self.scene.layout)
        theirs = [row for row, _ in shared]
        error = self.mean[theirs] - self.scene.state[[row for _, row in shared]]
        return nees(error, self.covariance[np.ix_(theirs, theirs)])

    @lazy
    def violated(self) -> BoolArray:
        """Whether any commanded platform is closer than ``min_range`` ``(N,)``."""
        return self.closest < self.min_range


@abstract
class RewardTerm(Component):
    """Base of reward terms; ``name`` is its key in ``info["reward_terms"]``."""

    name: str = ""
    weight: float

    def score(self, outcome: Outcome) -> Array:
        """The unweighted term ``(N,)`` after one sensor step; larger is better. May be a view."""
        raise AssertionError(f"{type(self).__name__} must define score")


@dataclass(frozen=True, kw_only=True)
class RangeBound(RewardTerm):
    """``−ln(σ_r / r)``: how well the range could be known, given the path flown."""

    name = "range_bound"
    weight: float = quantity("weight", 1.0)

    def score(self, outcome: Outcome) -> Array:
        """Minus the log range bound."""
        return -outcome.log_range_bound


@dataclass(frozen=True, kw_only=True)
class FinalBound(RewardTerm):
    """``−ln(√tr C_p / scale)`` at the last measurement, nothing before: for problems that are scored at their end."""

    name = "final_bound"
    weight: float = quantity("weight", 1.0)
    scale: float = quantity("bound on the position that counts as one", unit="m", above=0)

    def score(self, outcome: Outcome) -> Array:
        """Minus the logarithm of the Cramér–Rao bound on the position, at the end."""
        information = outcome.information
        bound = root_trace(information.bound, information.dynamics.layout.position)
        return np.where(outcome.last, -np.log(bound / self.scale), 0.0)


@dataclass(frozen=True, kw_only=True)
class GramGain(RewardTerm):
    """Observability gained: ``ln det(G_k + P₀⁻¹) − ln det(G_{k−1} + P₀⁻¹)``, G the Gramian in Fisher units."""

    name = "gram_gain"
    weight: float = quantity("weight", 0.05)

    def score(self, outcome: Outcome) -> Array:
        """The gain of this step's measurement."""
        return outcome.information.gram_gain


@dataclass(frozen=True, kw_only=True)
class TrackingError(RewardTerm):
    """``−min(e, 1)``, e the relative range error of the tracker's estimate."""

    name = "tracking_error"
    weight: float = quantity("weight", 0.1)

    def score(self, outcome: Outcome) -> Array:
        """Minus the relative error, at most one."""
        return -np.minimum(outcome.relative_range_error, 1.0)


@dataclass(frozen=True, kw_only=True)
class FilterCertainty(RewardTerm):
    """``−ln(det P_p)/(2 d) + ln |p̂ − p_own|``: how well the tracker believes to know the position, over its range.

    What the tracker claims, right or wrong: an overconfident filter is paid for its confidence. For experiments.
    """

    name = "filter_certainty"
    weight: float = quantity("weight", 1.0)

    def score(self, outcome: Outcome) -> Array:
        """Minus the logarithm of the believed deviation, the geometric mean over axes, relative to the range."""
        position = outcome.layout.position
        offset = outcome.mean[position] - outcome.pose.position
        half = 0.5 * log_determinant(cholesky(outcome.covariance[position, position]).lower) / len(offset)
        return np.log(distance(offset)) - half


@dataclass(frozen=True, kw_only=True)
class PositionError(RewardTerm):
    """``−min(|p̂ − p| / scale, 1)``, for emitters whose range means little."""

    name = "position_error"
    weight: float = quantity("weight", 1.0)
    scale: float = quantity("error that counts as one", unit="m", above=0)

    def score(self, outcome: Outcome) -> Array:
        """Minus the error of the estimate in units of the scale, at most one."""
        error = np.sqrt(inner(outcome.position_error, outcome.position_error))
        return -np.minimum(error / self.scale, 1.0)


@dataclass(frozen=True, kw_only=True)
class KeepOut(RewardTerm):
    """A bounded push away from the minimum range: 0 outside the margin, −1 at and inside ``min_range``."""

    name = "keep_out"
    weight: float = quantity("weight", 1.0)
    margin: float = quantity("width of the ramp as a share of min_range", 0.2, above=0)

    def score(self, outcome: Outcome) -> Array:
        """The ramp between ``min_range (1 + margin)`` and ``min_range``."""
        if outcome.min_range == 0.0:
            return zeros(outcome.closest, outcome.closest.shape)
        depth = (1.0 + self.margin - outcome.closest * (1.0 / outcome.min_range)) * (1.0 / self.margin)
        return -np.minimum(np.maximum(depth, 0.0), 1.0)


@dataclass(frozen=True, kw_only=True)
class ControlEffort(RewardTerm):
    """``−ω²/ω_ref²``: turning costs."""

    name = "control_effort"
    weight: float = quantity("weight", 0.05)
    reference: float = quantity("turn rate that counts as one", 0.05, unit="rad/s", above=0)

    def score(self, outcome: Outcome) -> Array:
        """Minus the square of the own ship's turn rate in units of the reference."""
        velocity, push = outcome.pose.velocity, outcome.pose.acceleration
        square = np.maximum((velocity * velocity).sum(axis=0), 1e-12)
        return -(push * push).sum(axis=0) / square / self.reference**2


DEFAULT_REWARD = (RangeBound(), GramGain(), TrackingError(), KeepOut())
"""Observability *and* tracking accuracy, with a keep-out."""
