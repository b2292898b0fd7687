"""The first fix of one satellite: where its measured direction meets an assumed height."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from passloc_env.arrays import Array, BoolArray, Number, numbers, zeros
from passloc_env.distributions import extremes
from passloc_env.errors import ScenarioError
from passloc_env.fields import count, quantity
from passloc_env.frames import EARTH_RADIUS, cross, from_geodetic, geodetic, local_axes, meet_height
from passloc_env.linalg import diagonal, inner, matmul, row_gram, transpose
from passloc_env.platforms import CircularOrbit, Platform
from passloc_env.sensors import PhaseDifference, Sensor
from passloc_env.sightline import Scene
from passloc_env.tracking.initialisation import FirstLook, Prior, blank

_STEEPEST = 0.999
"""Sine of the angle from straight down beyond which phases are not believed: at one, they tell no direction."""


@dataclass(frozen=True, kw_only=True)
class HeightPrior(Prior):
    """Single-satellite fix at an assumed height, velocity zero (paper 001, section on the initial state).

    Two interferometers of one satellite give a direction; with the height it becomes a position. With ``G`` the
    gradients of both phases and of the height, ``P₁ = G⁻¹ diag(σ_A², σ_B², σ_h²) G⁻ᵀ``. Misalignments of the body enter
    the fix, so they and the position begin correlated. Where noise lets the direction miss the Earth, the fix is the
    point of the line that lies nearest to the Earth's centre; where it grazes, the spread along it is the stretch that
    lies within ``σ_h`` of the height, for there the height is no slope but a parabola.

    An emitter that the satellite does not hear has no direction: the belief is then the point below the satellite, as
    uncertain along each axis as its horizon is far.
    """

    height: Number = quantity("assumed height above the ellipsoid", unit="m")
    height_sigma: Number = quantity("standard deviation of the height", unit="m", above=0)
    velocity_sigma: Number = quantity("standard deviation of the velocity per axis", unit="m/s", above=0)
    acceleration_sigma: Number = quantity("standard deviation of the acceleration per axis", 1.0, unit="m/s²", above=0)
    platform: int = count("index of the satellite that makes the fix", 0)

    def carrier_platform(self, sensors: tuple[Sensor, ...]) -> int:
        """The satellite that makes the fix."""
        return self.platform

    def check(self, sensors: tuple[Sensor, ...], platforms: tuple[Platform, ...], dimension: int) -> None:
        """The satellite must carry interferometers along two body axes, and fly above the height."""
        if dimension != 3:
            raise ScenarioError("platform", self.platform, "a fix at a height needs a scenario in space")
        axes = [sensor.axis for _, sensor in self._interferometers(sensors)]
        if sorted(axes) != [0, 1]:
            allowed = f"must carry one PhaseDifference along each of the axes 0 and 1; it has them along {axes}"
            raise ScenarioError("platform", self.platform, allowed)
        satellite = platforms[self.platform]
        # The orbit counts from the equatorial radius: nowhere is it closer to the ellipsoid.
        if isinstance(satellite, CircularOrbit) and extremes(self.height)[1] >= extremes(satellite.altitude)[0]:
            allowed = f"must be below the orbit, {extremes(satellite.altitude)[0]:g} m"
            raise ScenarioError("height", self.height, allowed)

    def _interferometers(self, sensors: tuple[Sensor, ...]) -> list[tuple[int, PhaseDifference]]:
        """The satellite's interferometers with their place among the sensors."""
        found = [(i, s) for i, s in enumerate(sensors) if isinstance(s, PhaseDifference)]
        return [(index, sensor) for index, sensor in found if sensor.platform == self.platform]

    def start(self, look: FirstLook) -> tuple[Array, Array]:
        """The fix, at rest."""
        fix = meet_height(self._origin(look), self._direction(look), self.height)
        mean = zeros(look.truth, look.truth.shape)
        mean[look.layout.position] = fix.position
        covariance = self._spread(look, mean, fix.normal)
        heard = self._heard(look)
        if not heard.all():
            mean[look.layout.position] = np.where(heard, fix.position, self._below(look))
            covariance = np.where(heard, covariance, self._unheard(look))
        return mean, covariance

    def at_truth(self, look: FirstLook) -> Array:
        """The same covariance with the gradients taken at the truth."""
        place = geodetic(look.truth[look.layout.position])
        covariance = self._spread(look, look.truth, local_axes(place.latitude, place.longitude)[2])
        heard = self._heard(look)
        return covariance if heard.all() else np.where(heard, covariance, self._unheard(look))

    def _heard(self, look: FirstLook) -> BoolArray:
        """Whether both phases were measured ``(N,)``."""
        if look.detected is None:
            return np.ones(look.measurement.shape[1], bool)
        return np.logical_and.reduce(look.detected[self._rows(look)], axis=0)

    def _rows(self, look: FirstLook) -> list[int]:
        """The phases among the measurements."""
        return [look.suite.rows[index].start for index, _ in self._interferometers(look.suite.sensors)]

    def _origin(self, look: FirstLook) -> Array:
        """Midway between the interferometers ``(3, N)``: metres, beside the hundreds of kilometres to the fix."""
        first, other = (look.pose.mounted(s.lever_arm) for _, s in self._interferometers(look.suite.sensors))
        return 0.5 * (first.position + other.position)

    def _below(self, look: FirstLook) -> Array:
        """The point at the height below the satellite ``(3, N)``."""
        place = geodetic(look.pose.position)
        return from_geodetic(place.latitude, place.longitude, np.broadcast_to(self.height, place.height.shape))

    def _unheard(self, look: FirstLook) -> Array:
        """Covariance ``(n, n, N)`` as wide as the horizon, ``√(a² − R²)`` away from an orbit of radius a."""
        _, covariance = blank(look, self.acceleration_sigma, look.truth.shape[1])
        own = look.pose.position
        diagonal(covariance)[look.layout.position] = np.maximum(inner(own, own) - EARTH_RADIUS**2, 0.0)
        diagonal(covariance)[look.layout.velocity] = np.square(self.velocity_sigma)
        return covariance

    def _direction(self, look: FirstLook) -> Array:
        """Unit vector ``(3, N)`` of the measured direction, taken to point below the satellite."""
        cosines = zeros(look.measurement, (3, look.measurement.shape[1]))
        for index, sensor in self._interferometers(look.suite.sensors):
            cosines[sensor.axis] = look.measurement[look.suite.rows[index].start] / sensor.radians_per_cosine
        across = np.sqrt(inner(cosines, cosines))
        cosines /= np.maximum(across / _STEEPEST, 1.0)
        cosines[2] = np.sqrt(1.0 - np.square(np.minimum(across, _STEEPEST)))
        return matmul(transpose(look.pose.attitude), cosines[:, None])[:, 0]

    def _spread(self, look: FirstLook, state: Array, normal: Array) -> Array:
        layout, nuisances = look.layout, look.layout.nuisances
        _, covariance = blank(look, self.acceleration_sigma, state.shape[1])
        rows = self._rows(look)
        jacobian = look.suite.jacobian(Scene(state, layout, look.poses))[rows]
        steep = self._steep(normal, state[layout.position] - self._origin(look))
        inverse = _inverse(np.concatenate([jacobian[:, layout.position], steep[None]]))
        sigma = (*np.sqrt(diagonal(look.suite.noise_covariance)[rows]), numbers(self.height_sigma))
        position = row_gram(inverse * np.stack([np.broadcast_to(s, normal.shape[1:]) for s in sigma]))
        if layout.nuisance:
            # δp = G⁻¹ (v − H_ε ε): what a misalignment adds to the fix, it also ties to it.
            lean = -matmul(inverse[:, :2], jacobian[:, nuisances])
            variance = diagonal(covariance)[nuisances]
            position += row_gram(lean * np.sqrt(variance))
            covariance[layout.position, nuisances] = lean * variance
            covariance[nuisances, layout.position] = transpose(lean * variance)
        covariance[layout.position, layout.position] = position
        diagonal(covariance)[layout.velocity] = np.square(self.velocity_sigma)
        return covariance

    def _steep(self, normal: Array, offset: Array) -> Array:
        """The gradient of the height, its slope along the line at least that of a grazing parabola, ``√(2 σ_h/R)``."""
        towards = offset / np.sqrt(inner(offset, offset))
        slope, least = inner(normal, towards), np.sqrt(2.0 * self.height_sigma / EARTH_RADIUS)
        return normal + (np.where(slope > 0.0, 1.0, -1.0) * np.maximum(np.abs(slope), least) - slope) * towards


def _inverse(matrix: Array) -> Array:
    """Inverse of ``(3, 3, N)`` by cofactors."""
    columns = np.stack([cross(matrix[1], matrix[2]), cross(matrix[2], matrix[0]), cross(matrix[0], matrix[1])], axis=1)
    return columns / inner(matrix[0], columns[:, 0])
