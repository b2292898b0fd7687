"""An unscented filter that knows what it means when an emitter passes an array.

While an emitter runs along the line through an array its bearing tells nothing of its range; the moment it passes, the
bearing turns right round. No Gramian and no Jacobian sees that jump, for it is not a slope. But it says that the
emitter was at the array between the last two looks, which is worth more than all bearings before.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from passloc_env.angles import direction, wrap
from passloc_env.arrays import Array, BoolArray, IntArray
from passloc_env.fields import quantity
from passloc_env.linalg import diagonal, inner, matvec, tree_sum
from passloc_env.platforms import Pose
from passloc_env.sensors import Bearing, Sensor
from passloc_env.tracking.correction import correct
from passloc_env.tracking.tracker import Models
from passloc_env.tracking.ukf import UnscentedKalman, UnscentedTrack


@dataclass(frozen=True, kw_only=True)
class CrossingKalman(UnscentedKalman):
    """Unscented filter that takes a bearing turned right round for a passage of the array.

    The passage happened at a time equally likely within the step of length T, so the emitter is now at
    ``p_array + v T/2`` with standard deviation ``|v| T/√12``; that replaces what the sensors of this array measured in
    this step, for which close by no linearisation holds. For the same reason an array need not be listened to while the
    belief reaches past it, within ``clearance`` standard deviations along the bearing: fit for emitters that pass by,
    not for those that stay near.
    """

    turn: float = quantity(
        "turn of a bearing within one step that means a passage", math.pi / 2, unit="rad", above=0, plain=True
    )

    clearance: float = quantity(
        "standard deviations by which the belief must stay this side of an array; 0 listens always",
        0.0,
        at_least=0,
        plain=True,
    )

    def build(self, models: Models, environments: int) -> CrossingTrack:
        """The running filter."""
        return CrossingTrack(self, models, environments)


class CrossingTrack(UnscentedTrack):
    """The running filter of a batch; remembers the last bearing of every array."""

    def __init__(self, filter_: CrossingKalman, models: Models, environments: int) -> None:
        super().__init__(filter_, models, environments)
        self._turn, self._clearance = filter_.turn, filter_.clearance
        self._arrays = [
            (index, rows.start)
            for index, (sensor, rows) in enumerate(zip(models.suite.sensors, models.suite.rows, strict=True))
            if isinstance(sensor, Bearing)
        ]
        self.last_bearings: Array = np.full((len(self._arrays), environments), np.nan)

    def start(self, columns: IntArray, mean: Array, covariance: Array, origin: Array | None = None) -> None:
        """Begin anew, with no bearing seen yet, in the given environments."""
        super().start(columns, mean, covariance, origin)
        self.last_bearings[:, columns] = np.nan

    def update(self, measurement: Array, poses: list[Pose], detected: BoolArray | None = None) -> None:
        """Passages first, then what the other sensors measured."""
        heard = np.ones(measurement.shape, bool) if detected is None else detected.copy()
        for last, (index, row) in zip(self.last_bearings, self._arrays, strict=True):
            array, bearing = self.models.suite.sensors[index], measurement[row]
            passed = heard[row] & (np.abs(wrap(bearing - last)) > self._turn)
            last[...] = np.where(heard[row], bearing, last)
            if passed.any():
                self._pass(array, poses, passed)
                self._silence(array, heard, passed)
            if self._clearance:
                self._silence(array, heard, heard[row] & self._reaches_past(array, bearing, poses))
        super().update(measurement, poses, None if detected is None and heard.all() else heard)

    def _reaches_past(self, array: Sensor, bearing: Array, poses: list[Pose]) -> BoolArray:
        """Where the belief lies closer to an array, along the bearing, than the clearance ``(N,)``."""
        towards, place = direction(bearing), self.models.layout.position.start
        level = slice(place, place + 2)
        away = inner(towards, self.mean[level] - poses[array.platform].mounted(array.lever_arm).position[:2])
        variance = inner(towards, matvec(self.covariance[level, level], towards))
        reaches: BoolArray = away < self._clearance * np.sqrt(variance)
        return reaches

    def _pass(self, array: Sensor, poses: list[Pose], passed: BoolArray) -> None:
        """Correct the position of the environments whose emitter has just passed an array.

        Where it passed, ``place − (p − v T/2)`` with v relative to the array, is zero but for the spread of the time:
        ``H = (I, −I T/2)`` on the level axes, for a bearing tells nothing of heights.
        """
        layout, half = self.models.layout, 0.5 * self.models.dynamics.period
        place, going = layout.position.start, layout.velocity.start
        level, moving = slice(place, place + 2), slice(going, going + 2)
        own = poses[array.platform].mounted(array.lever_arm)
        velocity = self.mean[moving] - own.velocity[:2]
        spread = tree_sum(diagonal(self.covariance)[moving].copy())
        variance = (inner(velocity, velocity) + spread) * (half * half / 3.0)
        floors = np.broadcast_to(variance, (2, *variance.shape))
        n = layout.size
        right = np.empty((2, n + 1, self.mean.shape[1]))
        right[:, :n] = self.covariance[level] - half * self.covariance[moving]
        right[:, n] = own.position[:2] + half * velocity - self.mean[level]
        innovation_covariance = right[:, level] - half * right[:, moving]
        diagonal(innovation_covariance)[...] += floors
        correct(self, right, innovation_covariance, floors, np.broadcast_to(passed, floors.shape))

    def _silence(self, array: Sensor, heard: BoolArray, columns: BoolArray) -> None:
        """Leave out what the sensors that listen at this array measured in some environments."""
        for sensor, rows in zip(self.models.suite.sensors, self.models.suite.rows, strict=True):
            if any(p == array.platform and np.array_equal(arm, array.lever_arm) for p, arm in sensor.places):
                heard[rows] &= ~columns

    def state_arrays(self) -> dict[str, np.ndarray]:
        """Everything that makes up the track's state, by name, batch axis last."""
        return super().state_arrays() | {"last_bearings": self.last_bearings}
