"""Several Gaussian beliefs side by side, weighed by how well each foretells the measurements: a Gaussian mixture.

With weights ``w_i`` and members ``N(x_i, P_i)`` the mixture's moments are

    x = Σ w_i x_i,   P = Σ w_i (P_i + (x_i − x)(x_i − x)ᵀ)

(Bar-Shalom, Li & Kirubarajan, *Estimation with Applications*, 1.4.16), and a measurement changes the weights by Bayes'
rule, ``w_i ← w_i L_i / Σ w_j L_j`` with the likelihood ``L_i`` of member i's innovation.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from passloc_env.arrays import Array, BoolArray, IntArray, lasting, zeros
from passloc_env.linalg import tree_sum
from passloc_env.tracking.tracker import Models, Track

_SMALLEST = 1e-300
"""No weight counts as less before a measurement, so that its logarithm is finite and a member may come back."""


@dataclass
class Members:
    """Beliefs side by side, each Gaussian.

    Attributes:
        mean: ``(n, M, N)``.
        covariance: ``(n, n, M, N)``.
        nis: normalised innovation squared of the last update ``(M, N)``.
        repairs: covariances repaired since last counted ``(M, N)``.
    """

    mean: Array
    covariance: Array
    nis: Array
    repairs: IntArray

    @classmethod
    def blank(cls, states: int, members: int, environments: int) -> Members:
        """All zero."""
        return cls.of(lasting((states, members, environments)), lasting((states, states, members, environments)))

    @classmethod
    def of(cls, mean: Array, covariance: Array) -> Members:
        """Members with these moments, kept as they are, that have not met a measurement yet."""
        return cls(mean, covariance, zeros(mean, mean.shape[1:]), np.zeros(mean.shape[1:], np.int64))

    def only(self, member: int) -> Members:
        """One member's belief ``(n, N)``, live."""
        return Members(self.mean[:, member], self.covariance[:, :, member], self.nis[member], self.repairs[member])


def moments(weights: Array, mean: Array, covariance: Array) -> tuple[Array, Array]:
    """Mean ``(n, N)`` and covariance ``(n, n, N)`` of mixtures.

    Args:
        weights: ``(M, N)``, summing to one.
        mean: the members' ``(n, M, N)``.
        covariance: the members' ``(n, n, M, N)``.
    """
    centre = tree_sum(np.moveaxis(weights * mean, 1, 0))
    apart = mean - centre[:, None]
    spread = apart[:, None] * apart
    spread += covariance
    spread *= weights
    return centre, tree_sum(np.moveaxis(spread, 2, 0))


class MixtureTrack(Track):
    """A running mixture: its mean and covariance are those of the members together.

    ``nis`` is the members', weighed; a member that went non-finite takes over the belief of the likeliest one with no
    weight of its own, and only where none is left does ``nis`` become non-finite.

    Attributes:
        members: in the layout of the track.
        weights: ``(M, N)``, summing to one.
        rows: the states that each member estimates, all by default.
    """

    def __init__(self, models: Models, environments: int, members: int) -> None:
        super().__init__(models, environments)
        self.rows: list[IntArray] = [np.arange(models.layout.size)] * members
        self.members = Members.blank(models.layout.size, members, environments)
        self.weights: Array = np.full((members, environments), 1.0 / members)

    def start(self, columns: IntArray, mean: Array, covariance: Array, origin: Array | None = None) -> None:
        """Begin anew in the given environments; what the members believe is for others to say."""
        super().start(columns, mean, covariance, origin)
        self.members.nis[:, columns] = 0.0
        self.members.repairs[:, columns] = 0

    @property
    def components(self) -> dict[str, Array]:
        """``weights (M, N)``, ``means (n, M, N)`` and ``covariances (n, n, M, N)`` of the members; live."""
        return {"weights": self.weights, "means": self.members.mean, "covariances": self.members.covariance}

    def combine(self) -> None:
        """Let mean and covariance be those of the mixture."""
        self.mean[...], self.covariance[...] = moments(self.weights, self.members.mean, self.members.covariance)

    def weigh(self, log_likelihood: Array) -> None:
        """Bayes' rule for the weights, from what the innovations say ``(M, N)``; then :meth:`combine`."""
        sound = np.isfinite(log_likelihood)
        whole = bool(np.logical_and.reduce(sound, axis=None))
        if not whole:
            log_likelihood = np.where(sound, log_likelihood, -np.inf)
        score = np.log(np.maximum(self.weights, _SMALLEST)) + log_likelihood
        weights = np.exp(score - np.maximum.reduce(score, axis=0))
        np.divide(weights, tree_sum(weights.copy()), out=self.weights)
        if not whole:
            self._revive(~sound)
        self.nis[...] = tree_sum(self.weights * self.members.nis)
        self._count_repairs()
        self.combine()

    def _revive(self, broken: BoolArray) -> None:
        """Give broken members ``(M, N)`` the belief of the likeliest one."""
        mean, covariance, nis = self.members.mean, self.members.covariance, self.members.nis
        likeliest = np.argmax(self.weights, axis=0)
        for member, column in zip(*np.nonzero(broken), strict=True):
            rows, best = self.rows[member], likeliest[column]
            block = np.ix_(rows, rows)
            mean[rows, member, column] = mean[rows, best, column]
            covariance[..., member, column][block] = covariance[..., best, column][block]
            nis[member, column] = nis[best, column]

    def _count_repairs(self) -> None:
        repairs = self.members.repairs
        if repairs.any():
            self.repairs += repairs.sum(axis=0)
            repairs[...] = 0

    def state_arrays(self) -> dict[str, np.ndarray]:
        """Everything that makes up the track's state, by name, batch axis last."""
        own = {
            "weights": self.weights,
            "member_means": self.members.mean,
            "member_covariances": self.members.covariance,
            "member_nis": self.members.nis,
            "member_repairs": self.members.repairs,
        }
        return super().state_arrays() | own
