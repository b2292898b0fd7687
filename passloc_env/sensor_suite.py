"""All sensors of a scenario as one measurement."""

from __future__ import annotations

from typing import Literal

import numpy as np

from passloc_env.angles import wrap_in_place
from passloc_env.arrays import Array, BoolArray, blank, zeros_for
from passloc_env.distributions import Distribution
from passloc_env.errors import ScenarioError
from passloc_env.linalg import LinearMap, cholesky, diagonal, solve_lower
from passloc_env.noise import StepNoise
from passloc_env.nuisance import Nuisance, distinct
from passloc_env.sensors import Sensor
from passloc_env.sightline import Scene

Arrival = Literal["in time", "late", "ever"]
"""When a measurement comes: at the instant when it is made, within the next period, or either of them."""


class SensorSuite:
    """Realised sensors stacked: ``m`` scalars in the order of the scenario.

    Attributes:
        size: number of scalars ``m``.
        noise_covariance: ``R (m, m, 1|N)``.
        noise_pivots: squared diagonal of its Cholesky factor ``(m, 1|N)``.
        may_miss: whether measurements may be absent by chance or by the clock.
        may_be_late: whether some may come within the next period.
    """

    def __init__(self, sensors: tuple[Sensor, ...], dense: bool = False) -> None:
        self.sensors = sensors
        self.size = sum(sensor.size for sensor in sensors)
        ends = np.cumsum([sensor.size for sensor in sensors])
        self.rows = [slice(int(end) - s.size, int(end)) for s, end in zip(sensors, ends, strict=True)]
        angular = [angle for sensor in sensors for angle in sensor.angular]
        self._angles = _runs(angular)
        self.noise_covariance = self._stack_noise()
        self._noise_root = root = cholesky(self.noise_covariance).lower
        self.noise_pivots = np.square(diagonal(root))
        self._disturb = LinearMap(root, dense=dense)
        self.may_miss, self._outlying = may_miss(sensors), outlying(sensors)
        self.may_be_late = any(sensor.faults.delaying for sensor in sensors)

    def _stack_noise(self) -> Array:
        blocks = [sensor.noise_covariance() for sensor in self.sensors]
        stacked = zeros_for((self.size, self.size, max(block.shape[-1] for block in blocks)), *blocks)
        for rows, block in zip(self.rows, blocks, strict=True):
            stacked[rows, rows] = block
        return stacked

    def measure(self, scene: Scene) -> Array:
        """The noise-free measurements ``(m, …, N)``."""
        stacked = blank(scene.state, (self.size, *scene.state.shape[1:]))
        for sensor, rows in zip(self.sensors, self.rows, strict=True):
            stacked[rows] = sensor.measure(scene)
        return stacked

    def jacobian(self, scene: Scene) -> Array:
        """Their derivative with respect to the state ``(m, n, …, N)``."""
        stacked = blank(scene.state, (self.size, *scene.state.shape))
        for sensor, rows in zip(self.sensors, self.rows, strict=True):
            stacked[rows] = sensor.jacobian(scene)
        return stacked

    def noise(self, errors: Array) -> Array:
        """Measurement noise ``(m, N)`` from uncorrelated errors of unit variance ``(m, N)``."""
        return self._disturb(errors)

    def inflation(self, draws: Array) -> Array | None:
        """How many times as wide as usual the error of each scalar is ``(m, N)``; None where there are no outliers.

        Args:
            draws: standard uniforms ``(2s, N)``, of which the first half decides.
        """
        if not self._outlying:
            return None
        inflation = blank(draws, (self.size, draws.shape[-1]))
        for sensor, rows, uniform in zip(self.sensors, self.rows, draws, strict=False):
            outlier = uniform < sensor.faults.outlier_probability
            inflation[rows] = np.where(outlier, sensor.faults.outlier_scale, 1.0)
        return inflation

    def chances(self, noise: StepNoise, time: Array, arrival: Arrival = "in time") -> Array | None:
        """One standard uniform per sensor ``(s, N)``, for :meth:`detected`; None when no sensor can miss by chance.

        It is 1, with which nothing is ever detected, where a measurement made at ``time (N,)`` is not what is asked
        for: one that comes in time, one that comes late, or either. During an outage there is none.
        """
        if not self.may_miss:
            return None
        uniforms = noise.detection.copy()
        for index, sensor in enumerate(self.sensors):
            if not sensor.faults.withholding and arrival != "late":
                continue
            absent = sensor.faults.out(time)
            if arrival != "ever":
                late = sensor.faults.late(noise.fault[len(self.sensors) + index])
                absent = absent | (late if arrival == "in time" else ~late)
            uniforms[index] = np.where(absent, 1.0, uniforms[index])
        return uniforms

    def whitened(self, rows: Array) -> Array:
        """``R^{-1/2} H`` for rows ``H (m, n, …)``, of independent noise with unit variance; a new array."""
        return solve_lower(self._noise_root, rows.copy())

    def noise_root(self, detected: BoolArray | None = None) -> Array:
        """The lower Cholesky factor of R ``(m, m, 1|N)``; undetected scalars are uncorrelated, with unit variance."""
        if detected is None:
            return self._noise_root
        missing = ~detected
        covariance = np.where(missing[:, None] | missing[None], 0.0, self.noise_covariance)
        diagonal(covariance)[...] = np.where(missing, 1.0, diagonal(covariance))
        return cholesky(covariance).lower

    def difference(self, left: Array, right: Array) -> Array:
        """``left − right`` for measurements ``(m, …, N)``, angles around the circle; a new array."""
        gap = left - right
        self.wrap(gap)
        return gap

    def wrap(self, measurements: Array) -> None:
        """Bring the angles of measurements or their differences ``(m, …, N)`` to [-π, π] in place."""
        for angles in self._angles:
            wrap_in_place(measurements[angles])

    def detected(self, scene: Scene, uniforms: Array | None) -> BoolArray | None:
        """Which scalars ``(m, N)`` are measured of true emitters ``(n, N)``; None when all are.

        Args:
            scene: what hides an emitter from a platform hides it from its sensors; and nothing is measured where there
                is nothing to measure, such as a direction on top of one.
            uniforms: one draw per sensor ``(s, N)``, for sensors that may miss.
        """
        hidden = [pose.hidden(scene.state[scene.layout.position]) for pose in scene.poses]
        undefined = [sensor.undefined(scene) for sensor in self.sensors]
        touched = any(mask.any() for mask in undefined)
        if uniforms is None and not touched and all(mask is None for mask in hidden):
            return None
        heard = np.ones_like(scene.state, bool, shape=(self.size, scene.state.shape[-1]))
        for index, (sensor, rows) in enumerate(zip(self.sensors, self.rows, strict=True)):
            if uniforms is not None:
                heard[rows] &= uniforms[index] < sensor.detection_probability
            if touched:
                heard[rows] &= ~undefined[index]
            for platform in sensor.platforms:
                mask = hidden[platform]
                if mask is not None:
                    heard[rows] &= ~mask
        return heard

    @property
    def uniform(self) -> tuple[int, ...]:
        """The scalars whose errors are uniform."""
        laws = [sensor.noise_law for sensor in self.sensors for _ in range(sensor.size)]
        return tuple(index for index, law in enumerate(laws) if law == "uniform")


def may_miss(sensors: tuple[Sensor, ...]) -> bool:
    """Whether measurements of any sensor may be absent at their time."""
    certain = [isinstance(s.detection_probability, float) and s.detection_probability == 1.0 for s in sensors]
    return not all(certain) or any(sensor.faults.withholding for sensor in sensors)


def outlying(sensors: tuple[Sensor, ...]) -> bool:
    """Whether the errors of any sensor may be outliers."""
    return any(sensor.faults.outlying for sensor in sensors)


def may_fail(sensors: tuple[Sensor, ...]) -> bool:
    """Whether anything may go wrong with any sensor."""
    return outlying(sensors) or any(sensor.faults.withholding for sensor in sensors)


def nuisances(sensors: tuple[Sensor, ...]) -> tuple[Nuisance, ...]:
    """The nuisance states that some sensors need, each once."""
    return distinct(nuisance for sensor in sensors for nuisance in sensor.nuisances)


def check_nuisances(sensors: tuple[Sensor, ...]) -> None:
    """Raise ScenarioError when sensors share a nuisance state but disagree on it.

    What is drawn at every reset is drawn for each sensor by itself, and so disagrees too.
    """
    known: dict[str, Nuisance] = {}
    for index, sensor in enumerate(sensors):
        for claim in sensor.nuisance_claims:
            first = known.setdefault(claim.name, claim)
            drawn = any(isinstance(number, Distribution) for number in (claim.sigma, claim.walk))
            if first is not claim and (drawn or first != claim):
                said = f"sigma {first.sigma}, walk {first.walk}"
                allowed = f"shares {claim.name} with another sensor and must say the same plain numbers, {said}"
                raise ScenarioError(f"sensors.{index}", type(sensor).__name__, allowed)


def _runs(flags: list[bool]) -> list[slice]:
    """Stretches of consecutive true flags."""
    runs: list[slice] = []
    for index, flag in enumerate(flags):
        if flag and runs and runs[-1].stop == index:
            runs[-1] = slice(runs[-1].start, index + 1)
        elif flag:
            runs.append(slice(index, index + 1))
    return runs
