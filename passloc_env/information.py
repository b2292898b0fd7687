"""Fisher information along the true geometry: the posterior Cramér–Rao bound and the Gram gain.

The posterior information recursion ``J ← (Q + F J⁻¹ Fᵀ)⁻¹ + Hᵀ R⁻¹ H`` (Tichavský, Muravchik & Nehorai 1998, for
linear motion) is carried in covariance form, ``C = J⁻¹``. A second copy without process noise carries the
observability Gramian in Fisher units: with ``C' = (G + P₀⁻¹)⁻¹`` mapped to the present, the determinant lemma gives

    ln det(G_k + P₀⁻¹) − ln det(G_{k−1} + P₀⁻¹) = ln det(I + R^{-1/2} H C' Hᵀ R^{-1/2}),

so the Gram gain falls out of the same update. Without process noise both are one.
"""

from __future__ import annotations

import numpy as np

from passloc_env.arrays import Array, BoolArray, IntArray, lasting
from passloc_env.dynamics import Dynamics
from passloc_env.linalg import diagonal, inner, matvec, mend
from passloc_env.sensor_suite import SensorSuite

_SMALLEST_VARIANCE = 1e-12


class Information:
    """The bound and the Gram gain of a batch, updated in place.

    Args:
        dynamics: how the emitter moves; linear.
        environments: how many.
        gram: whether the Gram gain is wanted; without it, and its noise-free copy, the bound costs half.

    Attributes:
        covariance: ``(n, n, k, N)``; ``[:, :, 0]`` is the bound, ``[:, :, -1]`` its noise-free copy.
        gram_gain: gain of the last measurement in ``ln det(G + P₀⁻¹)``, ``(N,)``; zero where it is not wanted.
    """

    def __init__(self, dynamics: Dynamics, environments: int, gram: bool = True) -> None:
        self.dynamics, self._gram = dynamics, gram
        n = dynamics.layout.size
        copies = 2 if gram and dynamics.noise_size else 1
        self.covariance: Array = lasting((n, n, copies, environments))
        self.gram_gain: Array = np.zeros(environments)

    @property
    def bound(self) -> Array:
        """The posterior Cramér–Rao bound on the state covariance ``(n, n, N)``, a view."""
        return self.covariance[:, :, 0]

    def start(self, columns: IntArray, prior: Array) -> None:
        """Begin anew in the given environments from the prior covariance at the truth ``(n, n, k)``."""
        self.covariance[..., columns] = prior[:, :, None]
        self.gram_gain[columns] = 0.0

    def advance(self) -> None:
        """``C ← F C Fᵀ + Q``, the noise-free copy without Q."""
        self.dynamics.transition.congruence(self.covariance)
        if self.dynamics.noise_size:
            self.covariance[:, :, 0] += self.dynamics.process_noise

    def absorb(self, jacobian: Array, suite: SensorSuite, detected: BoolArray | None = None) -> None:
        """Add ``Hᵀ R⁻¹ H`` of a measurement with Jacobian ``H (m, n, N)``; undetected rows add nothing.

        One scalar after the other, for the whitened ones are independent: with ``s = C h`` and ``v = 1 + hᵀ C h``,
        ``C ← C − s sᵀ/v``, and the Gram gain is ``ln Π v``.
        """
        if detected is not None:
            jacobian = jacobian * detected[:, None]
        growth: Array | float = 1.0
        for row in suite.whitened(jacobian)[:, :, None]:
            shared = matvec(self.covariance, row)
            variance = 1.0 + np.maximum(inner(row, shared), 0.0)
            shared *= 1.0 / np.sqrt(variance)
            self.covariance -= shared[:, None] * shared
            growth = growth * variance[-1]
        if self._gram:
            self.gram_gain[...] = np.log(growth)
        if not np.logical_and.reduce(np.minimum.reduce(diagonal(self.covariance)) > 0.0, axis=None):
            self._repair()

    def _repair(self) -> None:
        """Undo what cancellation does when a measurement is some 10⁷ times sharper than what was known before."""
        mend(self.covariance)

    def state_arrays(self) -> dict[str, np.ndarray]:
        """Everything that makes up its state, by name, batch axis last."""
        return {"covariance": self.covariance, "gram_gain": self.gram_gain}


def sigma_along(covariance: Array, axis: Array) -> Array:
    """Standard deviation ``(N,)`` along a unit vector ``(d, N)`` under a covariance ``(d, d, N)``."""
    variance = inner(axis, matvec(covariance, axis))
    return np.sqrt(np.maximum(variance, _SMALLEST_VARIANCE))
