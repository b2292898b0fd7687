"""The interface of every sensor.

A sensor says what it would measure in a :class:`~passloc_env.sightline.Scene`, how that changes with the state, how
noisy it is, where it sits, how often it misses, and which nuisance states it brings along. Everything else (noise,
stacking, wrapping, missing measurements, information) is the suite's business, so that a sensor is one class.
"""

from __future__ import annotations

import numpy as np

from passloc_env.arrays import Array, BoolArray, Number, numbers
from passloc_env.component import Component
from passloc_env.faults import SOUND, Faults
from passloc_env.fields import abstract
from passloc_env.nuisance import Nuisance
from passloc_env.sightline import Scene


@abstract
class Sensor(Component):
    """Base of sensors."""

    platform: int
    lever_arm: tuple[Number, ...]
    detection_probability: Number

    size: int = 1
    """Number of scalars per measurement."""

    angular: tuple[bool, ...] = (False,)
    """Which of them are angles, to be compared around the circle."""

    faults: Faults = SOUND
    """What goes wrong with it; a sensor that makes this a field lets scenarios say."""

    noise_law: str = "gaussian"
    """``"gaussian"``, or ``"uniform"`` for errors that are equally likely within ``√3`` standard deviations."""

    @property
    def places(self) -> tuple[tuple[int, tuple[Number, ...]], ...]:
        """Where it listens, platform and lever arm; a time difference listens at two places."""
        return ((self.platform, self.lever_arm),)

    @property
    def platforms(self) -> tuple[int, ...]:
        """The platforms it needs."""
        return tuple(platform for platform, _ in self.places)

    @property
    def nuisances(self) -> tuple[Nuisance, ...]:
        """The nuisance states it needs."""
        return ()

    @property
    def nuisance_claims(self) -> tuple[Nuisance, ...]:
        """What it says of nuisances: those it needs, and with the deviation 0 those it takes for known to all."""
        return self.nuisances

    def check(self, dimension: int) -> None:
        """Raise ScenarioError when the sensor does not fit a problem of this dimension."""

    def undefined(self, scene: Scene) -> BoolArray:
        """Where there is nothing to measure ``(…, N)``: the emitter is at the very place of the sensor."""
        nowhere: BoolArray = np.logical_or.reduce([scene.sightline(*place).on_top for place in self.places])
        return nowhere

    def measure(self, scene: Scene) -> Array:
        """The noise-free measurement ``(m, …, N)``."""
        raise AssertionError(f"{type(self).__name__} must define measure")

    def jacobian(self, scene: Scene) -> Array:
        """Its derivative with respect to the state ``(m, n, …, N)``."""
        raise AssertionError(f"{type(self).__name__} must define jacobian")

    def noise_covariance(self) -> Array:
        """``R (m, m, 1|N)``."""
        raise AssertionError(f"{type(self).__name__} must define noise_covariance")


def scalar_covariance(sigma: Number) -> Array:
    """``σ²`` as ``(1, 1, 1|N)``."""
    variance: Array = np.square(numbers(sigma))
    return variance[None, None]
