"""A prior for fixed cases whose papers only say how good the first guess is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from passloc_env.angles import direction
from passloc_env.arrays import Array, Number
from passloc_env.fields import count, quantity
from passloc_env.layout import StateLayout
from passloc_env.tracking.initialisation import CourselessPrior, FirstLook


@dataclass(frozen=True, kw_only=True)
class ScatteredPrior(CourselessPrior):
    """Range, velocity and acceleration drawn around the truth; the direction is the first bearing.

    ``cov = σ_r² u uᵀ + (r σ_θ)² t tᵀ`` for the position, ``σ_v²`` and ``σ_a²`` per axis.
    """

    range_sigma: Number = quantity("standard deviation of the range", unit="m", above=0)
    velocity_sigma: Number = quantity("standard deviation of the velocity per axis", unit="m/s", above=0)
    acceleration_sigma: Number = quantity("standard deviation of the acceleration per axis", 0.01, unit="m/s²", above=0)
    min_range: Number = quantity("smallest range ever drawn", 1.0, unit="m", above=0)
    sensor: int = count("index of the bearing sensor", 0)

    def normals_needed(self, layout: StateLayout) -> int:
        """The range, and each velocity and acceleration."""
        return 1 + layout.kinematic.stop - layout.dimension

    def start(self, look: FirstLook) -> tuple[Array, Array]:
        """Centred on the first measured bearing and on what was drawn."""
        bearing, sigma = self._first_bearing(look)
        _, true_range = self._truth_seen(look)
        layout = look.layout
        distance = np.maximum(true_range + self.range_sigma * look.normals[0], self.min_range)
        mean, covariance = self._spread(look, bearing, distance * sigma)
        mean[layout.position] = self._origin(look) + distance * direction(bearing)
        for row, normal in zip(range(layout.dimension, layout.kinematic.stop), look.normals[1:], strict=True):
            mean[row] = look.truth[row] + np.sqrt(covariance[row, row]) * normal
        return mean, covariance
