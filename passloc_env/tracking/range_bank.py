"""A bank of unscented filters, each sure of a stretch of range.

A bearing says nothing of the range, so one Gaussian wide enough for all ranges bends too much where the sensors look:
what spoils a filter is its coefficient of variation, the range's standard deviation over the range. The bank cuts the
prior along the line of sight into stretches whose ends grow by one common ratio; each member has the same small
coefficient, and the measurements tell which of them is right (Peach, *Bearings-only tracking using a set of
range-parameterised extended Kalman filters*, IEE Proc. CTA 142(1), 1995; Kronhamn, IEE Proc. RSN 145(4), 1998;
Ristic, Arulampalam & Gordon, *Beyond the Kalman Filter*, 6.3.2).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from passloc_env.arrays import Array, BoolArray, IntArray, zeros
from passloc_env.fields import count, quantity
from passloc_env.linalg import inner, matvec, tree_sum
from passloc_env.platforms import Pose
from passloc_env.sightline import distance
from passloc_env.special import erf
from passloc_env.tracking.correction import log_likelihood
from passloc_env.tracking.gating import gate_of
from passloc_env.tracking.mixture import MixtureTrack, moments
from passloc_env.tracking.tracker import Models
from passloc_env.tracking.ukf import UnscentedKalman

_NARROWEST = 1e-6
"""No standard deviation of the range counts as less than this share of the range."""


@dataclass(frozen=True, kw_only=True)
class RangeBank(UnscentedKalman):
    """Range-parameterised bank of unscented filters; any motion, any sensors.

    The prior is cut at ends that grow by one common ratio, from ``reach`` standard deviations this side of its mean
    range, or from ``nearest``, to ``reach`` beyond. A member has weight, mean and variance of its share of the prior,
    so that the mixture has those of the prior but for the tails cut off; a bank of one is the plain filter.

    A member that has lost its weight stays: it no longer counts, but measurements may bring it back. Dropping it for
    good, as the literature does to save time, costs a quarter in RMS on the severe own-ship case.
    """

    members: int = count("filters in the bank", 5, at_least=1)
    reach: float = quantity("standard deviations of range covered on either side", 3.0, above=0, at_most=6, plain=True)
    nearest: float = quantity(
        "smallest range covered, as a share of the largest", 0.1, above=0, at_most=0.5, plain=True
    )

    def build(self, models: Models, environments: int) -> RangeBankTrack:
        """The running bank; ScenarioError when kappa leaves no spread in this state size."""
        return RangeBankTrack(self, models, environments)


class RangeBankTrack(MixtureTrack):
    """The running bank of a batch."""

    def __init__(self, bank: RangeBank, models: Models, environments: int) -> None:
        super().__init__(models, environments, bank.members)
        self._bank, self._transform = bank, bank.transform(models.layout.size)
        self.gate = gate_of(bank.gate, models.suite)

    def start(self, columns: IntArray, mean: Array, covariance: Array, origin: Array | None = None) -> None:
        """Begin anew in the given environments, with the prior cut into stretches of range as seen from ``origin``."""
        super().start(columns, mean, covariance, origin)
        position = self.models.layout.position
        away = mean[position] - (0.0 if origin is None else origin)
        weights, means, covariances = self._split(mean, covariance, away)
        self.weights[:, columns] = weights
        self.members.mean[..., columns], self.members.covariance[..., columns] = means, covariances
        self.mean[:, columns], self.covariance[..., columns] = moments(weights, means, covariances)

    def predict(self, time: Array) -> None:
        """Every member's prediction."""
        self._transform.predict(self.members, self.models.dynamics, time)
        self.combine()

    def update(self, measurement: Array, poses: list[Pose], detected: BoolArray | None = None) -> None:
        """Every member's correction, and its weight."""
        lower = self._transform.update(self.members, self.models, measurement, poses, detected, self.admit)
        self.weigh(log_likelihood(self.members, lower))

    def admit(self, innovation: Array, covariance: Array, detected: BoolArray | None) -> BoolArray | None:
        """The same for the members' innovations ``(m, M, N)``, taken together: all use it or none."""
        if self.gate is None:
            return detected
        return super().admit(*moments(self.weights, innovation, covariance), detected)

    def _split(self, mean: Array, covariance: Array, away: Array) -> tuple[Array, Array, Array]:
        """Weights ``(M, k)``, means ``(n, M, k)`` and covariances ``(n, n, M, k)`` of the members.

        With ``g`` the gradient of the range r, a Gaussian is ``x = x̄ + κ (r − r̄) + e``, ``κ = P g / gᵀPg``, and ``e``
        independent of r. A member takes its own stretch of r; positions in ``e`` grow with its range, so that every
        member spans the same angle.
        """
        if self._bank.members == 1:
            return zeros(mean, mean[:1].shape) + 1.0, mean[:, None], covariance[:, :, None]
        position, centre = self.models.layout.position, distance(away)
        gradient = zeros(mean, mean.shape)
        gradient[position] = away / centre
        shared = matvec(covariance, gradient)
        variance = np.maximum(inner(gradient, shared), (_NARROWEST * centre) ** 2)
        weights, ranges, variances = self._stretches(centre, np.sqrt(variance))
        along = shared / variance
        means = mean[:, None] + along[:, None] * (ranges - centre)
        growth = zeros(mean, (len(mean), *ranges.shape)) + 1.0
        growth[position] = ranges / centre
        residual = (covariance - variance * (along[:, None] * along))[:, :, None]
        covariances = growth[:, None] * growth * residual + variances * (along[:, None] * along)[:, :, None]
        return weights, means, covariances

    def _stretches(self, centre: Array, sigma: Array) -> tuple[Array, Array, Array]:
        """Weight, mean and variance ``(M, k)`` of the range in each stretch: those of the prior cut to it."""
        bank = self._bank
        furthest = centre + bank.reach * sigma
        nearest = np.maximum(bank.nearest * furthest, centre - bank.reach * sigma)
        shares = np.arange(bank.members + 1)[:, None] / bank.members
        ends = nearest * (furthest / nearest) ** shares
        scaled = (ends - centre) / sigma
        mass = _differences(_normal_distribution(scaled))
        density = np.exp(-0.5 * scaled * scaled) / math.sqrt(2.0 * math.pi)
        shift = -_differences(density) / mass
        spread = 1.0 - _differences(scaled * density) / mass - shift * shift
        return mass / tree_sum(mass.copy()), centre + sigma * shift, sigma * sigma * spread


def _differences(values: Array) -> Array:
    """Each row but the first, less the one before it."""
    return values[1:] - values[:-1]


def _normal_distribution(x: Array) -> Array:
    """The standard normal distribution function."""
    distribution: Array = 0.5 * (1.0 + erf(x / math.sqrt(2.0)))
    return distribution
