"""A prior for emitters that are known to be in some region, whatever is heard first."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from passloc_env.arrays import Array, Number, zeros
from passloc_env.errors import ScenarioError
from passloc_env.fields import quantity, vector
from passloc_env.linalg import diagonal
from passloc_env.platforms import Platform
from passloc_env.sensors import Sensor
from passloc_env.tracking.initialisation import FirstLook, Prior, blank


@dataclass(frozen=True, kw_only=True)
class PlacePrior(Prior):
    """A place and how far from it the emitter may be, at rest but for ``velocity_sigma``."""

    position: tuple[Number, ...] = vector("centre of the region by axis", unit="m")
    position_sigma: Number = quantity("standard deviation of the position per axis", unit="m", above=0)
    velocity_sigma: Number = quantity("standard deviation of the velocity per axis", unit="m/s", above=0)
    acceleration_sigma: Number = quantity("standard deviation of the acceleration per axis", 0.01, unit="m/s²", above=0)

    def check(self, sensors: tuple[Sensor, ...], platforms: tuple[Platform, ...], dimension: int) -> None:
        """The place has as many axes as the problem."""
        if len(self.position) != dimension:
            raise ScenarioError("position", self.position, f"must have {dimension} axes")

    def start(self, look: FirstLook) -> tuple[Array, Array]:
        """The place."""
        mean, covariance = zeros(look.truth, look.truth.shape), self.at_truth(look)
        for axis, value in enumerate(self.position):
            mean[axis] = value
        return mean, covariance

    def at_truth(self, look: FirstLook) -> Array:
        """The same everywhere."""
        _, covariance = blank(look, self.acceleration_sigma, look.truth.shape[1])
        diagonal(covariance)[look.layout.position] = np.square(self.position_sigma)
        diagonal(covariance)[look.layout.velocity] = np.square(self.velocity_sigma)
        return covariance
