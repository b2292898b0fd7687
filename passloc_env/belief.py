"""What the agent sees: features of the tracker's belief, never the truth."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from passloc_env.angles import bearing_of
from passloc_env.arrays import Array, rows, zeros
from passloc_env.component import Component
from passloc_env.fields import quantity
from passloc_env.frames import cross
from passloc_env.layout import StateLayout
from passloc_env.linalg import diagonal, inner, matvec
from passloc_env.motion import Motion
from passloc_env.platforms import Platform, Pose
from passloc_env.sensors import Sensor
from passloc_env.sightline import distance

OBSERVATION_LIMIT = 10.0
"""Features are clipped to ± this."""


@dataclass
class Belief:
    """All that a policy may know, batched.

    Attributes:
        time: seconds since the episode began ``(N,)``.
        time_left: seconds until it ends ``(N,)``.
        interval: seconds between decisions.
        period: seconds between measurements.
        mean: ``(n, N)``.
        covariance: ``(n, n, N)``.
        layout: rows of the state.
        poses: reported pose of every platform.
        platforms: their configurations, with this episode's numbers.
        sensors: what they hear, likewise.
        motion: a linear motion to forecast by, likewise: the tracker's, or the bound's where that is none.
        own_ship: index of the platform that the line of sight is drawn from.
        min_range: the keep-out radius, m.
        last_action: the action in force ``(a, N)``.
        components: further beliefs of multi-model trackers, by name.
    """

    time: Array
    time_left: Array
    interval: float
    period: float
    mean: Array
    covariance: Array
    layout: StateLayout
    poses: list[Pose]
    platforms: tuple[Platform, ...]
    sensors: tuple[Sensor, ...]
    motion: Motion
    own_ship: int
    min_range: float
    last_action: Array
    components: dict[str, Array] = field(default_factory=dict)

    @property
    def offset(self) -> Array:
        """Believed emitter position relative to the own ship ``(d, N)``, m."""
        return self.mean[self.layout.position] - self.poses[self.own_ship].position

    @property
    def range(self) -> Array:
        """Believed range ``(N,)``, m."""
        return distance(self.offset)

    @property
    def line_of_sight(self) -> Array:
        """Believed unit vector to the emitter ``(d, N)``."""
        return self.offset / self.range

    @property
    def bearing(self) -> Array:
        """Believed bearing of the emitter ``(N,)``, rad, from the second axis of the frame towards the first.

        A compass bearing where these are north and east, that is, in local axes.
        """
        return bearing_of(self.offset)


def line_of_sight_axes(direction: Array) -> Array:
    """Orthonormal axes ``(d, d, N)`` as rows: along the line of sight, across it, and the remaining one.

    Across is at right angles to the third axis of the frame, and the last axis leans towards that one: starboard and
    upward where the frame is local (east, north, up).
    """
    if len(direction) == 2:
        return rows(direction, rows(direction[1], -direction[0]))
    horizontal = np.stack([direction[1], -direction[0], zeros(direction, direction.shape[-1:])])
    length = np.sqrt(inner(horizontal, horizontal))
    overhead = length < 1e-9
    horizontal[0] = np.where(overhead, 1.0, horizontal[0])
    across = horizontal / np.where(overhead, 1.0, length)
    return np.stack([direction, across, cross(across, direction)])


@dataclass(frozen=True, kw_only=True)
class BeliefFeatures(Component):
    """The observation: the belief in the frame of its own line of sight, scaled to the order of one.

    Means, logarithms of the standard deviations, and correlations of the posterior, own velocity, where other platforms
    are and how bodies point that can be turned, time left and the last action. Without the covariance an agent cannot
    tell what it does not know yet.
    """

    range_scale: float = quantity("range that counts as one", 40e3, unit="m", above=0)
    speed_scale: float = quantity("speed that counts as one", 200.0, unit="m/s", above=0)
    acceleration_scale: float = quantity("acceleration that counts as one", 1.0, unit="m/s²", above=0)
    nuisance_scale: float = quantity("nuisance standard deviation that counts as one", 1.0, above=0)

    def names(self, layout: StateLayout, platforms: tuple[Platform, ...], own_ship: int) -> tuple[str, ...]:
        """The name of each feature, in order."""
        axes = ("along", "across", "up")[: layout.dimension]
        derivatives = ("position", "velocity", "acceleration")[: layout.order + 1]
        states = [f"{derivative} {axis}" for derivative in derivatives for axis in axes] + list(layout.nuisance)
        others = [f"platform {p} offset {axis}" for p in range(len(platforms)) if p != own_ship for axis in axes]
        bodies = [
            f"platform {p} body axis {row} {axis}"
            for p, platform in enumerate(platforms)
            if platform.steers_body
            for row in range(layout.dimension)
            for axis in axes
        ]
        return (
            "ln range",
            *(f"own velocity {axis}" for axis in axes),
            *(f"emitter velocity {axis}" for axis in axes),
            *others,
            *bodies,
            *(f"ln sigma of {state}" for state in states),
            *(f"correlation of {a} and {b}" for i, a in enumerate(states) for b in states[:i]),
            "time left",
            *(f"last action {a}" for a in range(sum(platform.controls for platform in platforms))),
        )

    def observe(self, belief: Belief) -> Array:
        """The features ``(f, N)``, finite and within ± :data:`OBSERVATION_LIMIT`."""
        layout = belief.layout
        axes = line_of_sight_axes(belief.line_of_sight)
        own = belief.poses[belief.own_ship]
        believed_range = belief.range
        others = [
            matvec(axes, pose.position - own.position) / believed_range
            for index, pose in enumerate(belief.poses)
            if index != belief.own_ship
        ]
        bodies = [
            matvec(axes, body_axis)
            for platform, pose in zip(belief.platforms, belief.poses, strict=True)
            if platform.steers_body
            for body_axis in pose.attitude
        ]
        sigma, correlation = self._spread(belief, axes, believed_range)
        parts = [
            np.log(believed_range / self.range_scale)[None],
            matvec(axes, own.velocity) / self.speed_scale,
            matvec(axes, belief.mean[layout.velocity]) / self.speed_scale,
            *others,
            *bodies,
            sigma,
            correlation,
            (belief.time_left / (belief.time + belief.time_left))[None],
            belief.last_action,
        ]
        features = np.concatenate(parts)
        np.minimum(features, OBSERVATION_LIMIT, out=features)
        np.maximum(features, -OBSERVATION_LIMIT, out=features)
        # What is not a number becomes zero, and every zero the same one.
        return np.where(np.abs(features) > 0.0, features, 0.0)

    def _spread(self, belief: Belief, axes: Array, believed_range: Array) -> tuple[Array, Array]:
        """Log standard deviations ``(n, N)`` and correlations ``(n (n − 1) / 2, N)`` in the line-of-sight frame."""
        layout = belief.layout
        covariance = _rotated(belief.covariance, axes, layout)
        sigma = np.sqrt(np.maximum(diagonal(covariance), 1e-300))
        relative = covariance / (sigma[:, None] * sigma)
        correlation = np.concatenate([relative[row, :row] for row in range(1, layout.size)])
        scaled = sigma.copy()
        scaled[layout.position] /= believed_range
        scaled[layout.velocity] /= self.speed_scale
        scaled[layout.acceleration] /= self.acceleration_scale
        scaled[layout.nuisances] /= self.nuisance_scale
        return np.log(scaled), correlation


def _rotated(covariance: Array, axes: Array, layout: StateLayout) -> Array:
    """``B P Bᵀ`` with the axes as the blocks of B for position, velocity and acceleration."""
    d, n = layout.dimension, layout.size
    rotated = covariance.copy()
    for _ in range(2):
        for block in (layout.position, layout.velocity, layout.acceleration):
            if block.stop > block.start:
                stripe = rotated[block].reshape(d, 1, n, -1)
                rotated[block] = sum(axes[:, k, None] * stripe[k] for k in range(d))
        rotated = rotated.swapaxes(0, 1)
    return rotated
