"""A tracker that crosses all bearings heard so far: the emitter stays, the stations move."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from passloc_env.arrays import Array, BoolArray, IntArray
from passloc_env.errors import ScenarioError
from passloc_env.fields import count, flag, part, quantity
from passloc_env.linalg import diagonal, tree_sum
from passloc_env.motion import ConstantVelocity, Motion
from passloc_env.platforms import Pose
from passloc_env.sensors import Bearing, Sensor
from passloc_env.tracking.rays import Rays, Symmetric, closest
from passloc_env.tracking.tracker import Models, Track, Tracker

_FEW = 6.0
"""Rays below which the pull is hardly taken back: what is right on average adds noise to a few."""

_BEARABLE = 0.5
"""Share of the smallest eigenvalue of the normal matrix that may be taken back."""


@dataclass(frozen=True, kw_only=True)
class RecursiveCrossFix(Tracker):
    """Positive-range least squares over the bearing rays of many looks (paper 004, eq. 12), for emitters that stay.

    The belief's mean is the point closest to all rays and, with the weight of ``prior_rays`` rays, to the prior's
    centre. Its covariance is ``s² A⁻¹``, A the normal matrix and ``s²`` the mean squared distance to the rays, the
    prior's own variance counted as ``prior_rays`` more of them.

    Wide errors bias least squares: with an error δ of the bearing, ``E[n nᵀ] = (1 − 2b) n₀n₀ᵀ + b I``, ``b = E sin²δ``,
    so that each station pulls the fix towards itself with the weight b, however many looks there are. ``compensated``
    takes the pull back, carefully while rays are few; without it the fix is the paper's.
    """

    motion: Motion = part(Motion, "how the emitter moves; it stays where it is", ConstantVelocity())
    memory: int = count("looks that are kept, the newest ones", 64, at_least=1)
    compensated: bool = flag("whether the stations' pull on the fix is taken back", True)
    prior_rays: float = quantity("rays that the prior is worth", 0.5, at_least=1e-9, plain=True)

    def check(self, sensors: tuple[Sensor, ...], dimension: int) -> None:
        """Bearings in the plane are all it takes."""
        others = [type(sensor).__name__ for sensor in sensors if not isinstance(sensor, Bearing)]
        if others or dimension != 2:
            found = others[0] if others else f"{dimension} axes"
            raise ScenarioError("tracker", found, "RecursiveCrossFix takes Bearing sensors in the plane only")

    def build(self, models: Models, environments: int) -> CrossFixTrack:
        """The running tracker."""
        return CrossFixTrack(self, models, environments)


class CrossFixTrack(Track):
    """The rays of a batch, in rings of the newest looks.

    Attributes:
        stations: where each ray was heard ``(2, looks, m, N)``.
        bearings: of each ray ``(looks, m, N)``.
        heard: whether there is such a ray ``(looks, m, N)``.
        looks: looks so far ``(N,)``.
        centre: the prior's centre ``(2, N)``.
        spread: the prior's variance per axis ``(N,)``.
    """

    def __init__(self, tracker: RecursiveCrossFix, models: Models, environments: int) -> None:
        super().__init__(models, environments)
        rays = (tracker.memory, models.suite.size, environments)
        self._weight, self._compensated = tracker.prior_rays, tracker.compensated
        self.stations: Array = np.zeros((2, *rays))
        self.bearings: Array = np.zeros(rays)
        self.heard: BoolArray = np.zeros(rays, bool)
        self.looks: IntArray = np.zeros(environments, np.int64)
        self.centre: Array = np.zeros((2, environments))
        self.spread: Array = np.zeros(environments)

    @property
    def _bearing_sensors(self) -> list[Bearing]:
        return [sensor for sensor in self.models.suite.sensors if isinstance(sensor, Bearing)]

    def start(self, columns: IntArray, mean: Array, covariance: Array, origin: Array | None = None) -> None:
        """Begin anew, with no ray heard yet, in the given environments."""
        super().start(columns, mean, covariance, origin)
        position = self.models.layout.position
        for rays in (self.stations, self.bearings, self.heard):
            rays[..., columns] = 0
        self.looks[columns] = 0
        self.centre[:, columns] = mean[position]
        self.spread[columns] = 0.5 * diagonal(covariance)[position].sum(axis=0)

    def predict(self, time: Array) -> None:
        """The emitter stays."""
        self.nis[...] = 0.0

    def update(self, measurement: Array, poses: list[Pose], detected: BoolArray | None = None) -> None:
        """Add this look's rays and cross all that are kept."""
        everything = np.ones(measurement.shape, bool)
        self.looks += 1
        self._add(measurement, poses, everything, everything if detected is None else detected)
        self._cross()
        finite = np.isfinite(self.mean).all(axis=0) & np.isfinite(self.covariance).all(axis=(0, 1))
        self.nis[...] = np.where(finite, 0.0, np.nan)

    def catch_up(self, measurement: Array, poses: list[Pose], late: BoolArray | None) -> None:
        """Add what comes late to the rays of the last look; the next one crosses them."""
        heard = np.ones(measurement.shape, bool) if late is None else late
        self._add(measurement, poses, heard, heard)

    def _add(self, measurement: Array, poses: list[Pose], known: BoolArray, heard: BoolArray) -> None:
        """Say of some rays of the newest look ``(m, N)`` what is known: where they were heard, if at all."""
        for index, sensor in enumerate(self._bearing_sensors):
            columns = np.flatnonzero(known[index])
            slot = (self.looks[columns] - 1) % len(self.bearings)
            place = poses[sensor.platform].mounted(sensor.lever_arm).position
            self.stations[:, slot, index, columns] = place[:, columns]
            self.bearings[slot, index, columns] = measurement[index, columns]
            self.heard[slot, index, columns] = heard[index, columns]

    def _cross(self) -> None:
        """The point closest to the rays and the prior's centre, and its covariance."""
        position, n = self.models.layout.position, len(self.looks)
        heard, weight = self.heard.reshape(-1, n), np.full(n, self._weight)
        relative = self.stations.reshape(2, -1, n) - self.centre[:, None]
        rays = Rays.from_stations(relative, self.bearings.reshape(-1, n), np.zeros((2, n)), weight).only(heard)
        point, behind, normal = closest(rays)
        if self._compensated:
            point, normal = self._released(point, normal, relative, heard & ~behind)
        cost = rays.cost(point, rays.seen(point))
        variance = (cost + self._weight * self.spread) / (tree_sum(heard.astype(float)) + self._weight)
        scale = variance / normal.determinant
        self.mean[position] = self.centre + point
        east, north = position.start, position.start + 1
        self.covariance[east, east], self.covariance[north, north] = scale * normal.yy, scale * normal.xx
        self.covariance[east, north] = self.covariance[north, east] = -scale * normal.xy

    def _released(self, point: Array, normal: Symmetric, relative: Array, active: BoolArray) -> tuple[Array, Symmetric]:
        """The point and the normal matrix with the stations' pull taken back, as far as the rays can bear it."""
        each = np.stack([np.broadcast_to(s.mean_squared_sine, active.shape[1:]) for s in self._bearing_sensors])
        pulls = np.tile(each, (len(self.bearings), 1)) * active
        rays, total = tree_sum(active.astype(float)), tree_sum(pulls.copy())
        half = 0.5 * (normal.xx + normal.yy)
        smallest = half - np.hypot(0.5 * (normal.xx - normal.yy), normal.xy)
        wanted = total * rays / (rays + _FEW)
        share = np.minimum(wanted, _BEARABLE * smallest) / np.maximum(total, 1e-300)
        back = share * tree_sum(pulls[:, None] * (point - np.moveaxis(relative, 1, 0)))
        weaker = Symmetric(normal.xx - share * total, normal.xy, normal.yy - share * total)
        return point + weaker.solve(back), weaker

    def state_arrays(self) -> dict[str, np.ndarray]:
        """Everything that makes up the track's state, by name, batch axis last."""
        own = ("stations", "bearings", "heard", "looks", "centre", "spread")
        return super().state_arrays() | {name: getattr(self, name) for name in own}
