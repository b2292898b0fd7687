"""Relative geometry between emitter states and observers, computed once and shared by all sensors."""

from __future__ import annotations

import numpy as np

from passloc_env.angles import bearing_of
from passloc_env.arrays import Array, BoolArray, Number, zeros
from passloc_env.layout import StateLayout
from passloc_env.lazy import lazy
from passloc_env.linalg import inner
from passloc_env.platforms import Pose

_CLOSEST = 1e-3
"""Ranges are never taken below this many metres: directions and rates stay finite on top of the emitter."""


def distance(offset: Array) -> Array:
    """Length ``(…, N)`` of offsets ``(d, …, N)``, m, at least a millimetre."""
    return np.maximum(np.sqrt(inner(offset, offset)), _CLOSEST)


class Sightline:
    """The line from a pose to emitter states ``(n, …, N)``; every quantity keeps the middle axes."""

    def __init__(self, state: Array, layout: StateLayout, pose: Pose) -> None:
        self._state, self._layout, self.pose = state, layout, pose
        self._middle = (slice(None), *(None,) * (state.ndim - 2))

    @lazy
    def offset(self) -> Array:
        """Emitter position minus own position, ``(d, …, N)``, m."""
        return self._state[self._layout.position] - self.pose.position[self._middle]

    @lazy
    def velocity(self) -> Array:
        """Emitter velocity minus own velocity, ``(d, …, N)``, m/s."""
        return self._state[self._layout.velocity] - self.pose.velocity[self._middle]

    @lazy
    def acceleration(self) -> Array:
        """Emitter acceleration (where it is a state) minus own acceleration, ``(d, …, N)``, m/s²."""
        own = self.pose.acceleration[self._middle]
        if self._layout.order > 1:
            return self._state[self._layout.acceleration] - own
        return np.broadcast_to(-own, self.offset.shape)

    @lazy
    def range(self) -> Array:
        """Distance ``(…, N)``, m, at least a millimetre."""
        return distance(self.offset)

    @lazy
    def nearness(self) -> Array:
        """One over the range ``(…, N)``, 1/m: a division serves all that are to be divided by the range."""
        return 1.0 / self.range

    @lazy
    def on_top(self) -> BoolArray:
        """Whether the emitter is at the very place ``(…, N)``: then no direction exists, and nothing is measured."""
        on_top: BoolArray = self.range <= _CLOSEST
        return on_top

    @lazy
    def plumb(self) -> BoolArray:
        """Whether the emitter is straight above or below ``(…, N)``, or on top: then it has no bearing."""
        if len(self.offset) == 2:
            return self.on_top
        plumb: BoolArray = distance(self.offset[:2]) <= _CLOSEST
        return plumb

    @lazy
    def direction(self) -> Array:
        """Unit vector to the emitter ``(d, …, N)``."""
        return self.offset * self.nearness

    @lazy
    def bearing(self) -> Array:
        """Compass bearing of the emitter ``(…, N)``, rad."""
        return bearing_of(self.offset)

    @lazy
    def range_rate(self) -> Array:
        """Rate of change of the range ``(…, N)``, m/s."""
        return inner(self.offset, self.velocity) * self.nearness

    @lazy
    def range_acceleration(self) -> Array:
        """Second derivative of the range ``(…, N)``, m/s²: ``(v² − ṙ²)/r + u·a``."""
        turning = (inner(self.velocity, self.velocity) - self.range_rate * self.range_rate) * self.nearness
        return turning + inner(self.direction, self.acceleration)


class Scene:
    """Emitter states seen from all platforms at one instant.

    Args:
        state: ``(n, …, N)``; the middle axes hold e.g. sigma points.
        layout: its rows.
        poses: one pose per platform, ``(d, N)`` each.
    """

    def __init__(self, state: Array, layout: StateLayout, poses: list[Pose]) -> None:
        self.state, self.layout, self.poses = state, layout, poses
        self._sightlines: dict[tuple[Number, ...], tuple[Sightline, tuple[Number, ...]]] = {}

    def sightline(self, platform: int, lever_arm: tuple[Number, ...] = ()) -> Sightline:
        """The line from a point of a platform to the emitter, computed on first use."""
        # Arrays are known by identity, so the arm is kept beside its line for as long as the line is.
        key = (platform, *(id(arm) if isinstance(arm, np.ndarray) else arm for arm in lever_arm))
        known = self._sightlines.get(key)
        if known is None:
            line = Sightline(self.state, self.layout, self.poses[platform].mounted(lever_arm))
            self._sightlines[key] = known = (line, lever_arm)
        return known[0]

    def nuisance(self, name: str) -> Array:
        """A nuisance state ``(…, N)``."""
        row: Array = self.state[self.layout.nuisance_row(name)]
        return row

    def empty_jacobian(self, rows: int) -> Array:
        """Zeros ``(rows, n, …, N)`` for a sensor to fill."""
        return zeros(self.state, (rows, *self.state.shape))
