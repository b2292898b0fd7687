"""What every tracker is: a configuration that builds a running track over a batch of environments."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from passloc_env.arrays import Array, BoolArray, IntArray, lasting
from passloc_env.component import Component
from passloc_env.dynamics import Dynamics
from passloc_env.fields import abstract
from passloc_env.layout import StateLayout
from passloc_env.motion import Motion
from passloc_env.platforms import Pose
from passloc_env.sensor_suite import SensorSuite
from passloc_env.sensors import Sensor
from passloc_env.tracking.gating import Gate


@dataclass
class Models:
    """What a tracker believes about the world: state, motion and sensors, all realised."""

    layout: StateLayout
    dynamics: Dynamics
    suite: SensorSuite
    members: tuple[Models, ...] = ()
    """Those of the motions that a multi-model tracker switches between, each with a layout of its own."""


@abstract
class Tracker(Component):
    """Base of tracker configurations."""

    motion: Motion

    def check(self, sensors: tuple[Sensor, ...], dimension: int) -> None:
        """Raise ScenarioError when the tracker does not fit the scenario."""

    def build(self, models: Models, environments: int) -> Track:
        """The running tracker of ``environments`` environments."""
        raise AssertionError(f"{type(self).__name__} must define build")


class Track:
    """A running tracker: the belief of every environment of a batch, updated in place.

    Attributes:
        models: replaced by the simulation whenever a reset has sampled new numbers.
        mean: ``(n, N)``.
        covariance: ``(n, n, N)``, symmetric to the last bit and positive definite.
        nis: normalised innovation squared of the last update ``(N,)``.
        repairs: how often each environment's covariance had to be repaired ``(N,)``.
        gate: what keeps unlikely measurements out; None where all come in.
        gated: how many measurements it has kept out ``(N,)``, each sensor's counted by itself.
    """

    gate: Gate | None = None

    def __init__(self, models: Models, environments: int) -> None:
        self.models = models
        n = models.layout.size
        self.mean: Array = lasting((n, environments))
        self.covariance: Array = lasting((n, n, environments))
        self.nis: Array = np.zeros(environments)
        self.repairs: IntArray = np.zeros(environments, np.int64)
        self.gated: IntArray = np.zeros(environments, np.int64)

    def start(self, columns: IntArray, mean: Array, covariance: Array, origin: Array | None = None) -> None:
        """Begin anew in the given environments from a prior ``(n, k)``, ``(n, n, k)``.

        ``origin (d, k)`` is the reported position from which the prior was made; None means the origin of coordinates.
        """
        self.mean[:, columns] = mean
        self.covariance[..., columns] = covariance
        self.nis[columns] = 0.0
        self.repairs[columns] = 0
        self.gated[columns] = 0

    def predict(self, time: Array) -> None:
        """Advance the belief by one period from ``time (N,)``."""
        raise AssertionError(f"{type(self).__name__} must define predict")

    def update(self, measurement: Array, poses: list[Pose], detected: BoolArray | None = None) -> None:
        """Absorb a measurement ``(m, N)`` made from the reported poses.

        ``detected (m, N)`` tells which scalars were made at all; None means all.
        """
        raise AssertionError(f"{type(self).__name__} must define update")

    def catch_up(self, measurement: Array, poses: list[Pose], late: BoolArray | None) -> None:
        """Absorb what of a measurement ``(m, N)`` comes late ``(m, N)``, before the belief leaves its instant."""
        self.update(measurement, poses, late)

    def admit(self, innovation: Array, covariance: Array, detected: BoolArray | None) -> BoolArray | None:
        """Which scalars are to be used ``(m, N)``, None for all: of those detected, what the gate lets in.

        Args:
            innovation: ``(m, N)``.
            covariance: ``S (m, m, N)``, what it was expected with.
            detected: which scalars were measured ``(m, N)``; None means all.
        """
        if self.gate is None:
            return detected
        return self.sift(self.gate.passed(innovation, covariance, self.models.suite), detected)

    def sift(self, passed: BoolArray, detected: BoolArray | None) -> BoolArray:
        """What of the detected has passed the gate ``(m, N)``; the sensors refused are counted."""
        refused = ~passed if detected is None else detected & ~passed
        for rows in self.models.suite.rows:
            self.gated += np.where(refused[rows.start], 1, 0)
        return passed if detected is None else detected & passed

    @property
    def components(self) -> dict[str, Array]:
        """Further beliefs of multi-model trackers by name, batch axis last, live; none by default."""
        return {}

    def state_arrays(self) -> dict[str, np.ndarray]:
        """Everything that makes up the track's state, by name, batch axis last."""
        counts = {"nis": self.nis, "repairs": self.repairs, "gated": self.gated}
        return {"mean": self.mean, "covariance": self.covariance, **counts}
