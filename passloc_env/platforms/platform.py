"""The interface of every observer.

A platform keeps its state in one array ``(rows, N)`` and answers three questions: what a command means
(:meth:`Platform.set_point`), where it goes in a step (:meth:`Platform.move`), and what its pose is, twice: the *true*
one, from which the world measures, and the *reported* one, which tracker and agent get. Navigation and attitude errors
live in the difference; platforms without them report the truth.
"""

from __future__ import annotations

from passloc_env.arrays import Array, Number, zeros, zeros_for
from passloc_env.component import Component
from passloc_env.fields import abstract
from passloc_env.noise import NavigationErrors
from passloc_env.platforms.pose import Pose


@abstract
class Platform(Component):
    """Base of observers."""

    controls: int = 0
    """Number of action components the platform takes, each in [-1, 1]."""

    steers_body: bool = False
    """Whether its commands turn the body apart from the course, so that an agent must be told the attitude."""

    set_points: int = 0
    """Rows of the set-point that a command becomes."""

    dimension: int = 2
    """Number of spatial axes it lives in."""

    constant_errors: int = 0
    """Standard normals that make up its navigation errors of a whole episode."""

    fresh_errors: int = 0
    """Standard normals that make up those of each instant."""

    def start(self, environments: int) -> Array:
        """The state ``(rows, N)`` at the beginning of an episode."""
        raise AssertionError(f"{type(self).__name__} must define start")

    def state_at(self, pose: Pose) -> Array:
        """The state ``(rows, N)`` in which the platform has this pose, as far as a pose can tell: for looking ahead."""
        raise AssertionError(f"{type(self).__name__} must define state_at to be planned for")

    def set_point(self, state: Array, action: Array, line_of_sight: Array) -> Array:
        """What to hold until the next decision, ``(set_points, N)``.

        Args:
            state: the platform's state ``(rows, N)``.
            action: its part of the action ``(controls, N)``, already within [-1, 1].
            line_of_sight: believed unit vector to the emitter ``(d, N)``.
        """
        return zeros(state, (self.set_points, state.shape[-1]))

    def move(self, state: Array, set_point: Array, period: float) -> Array:
        """The state one period (s) later; a new array."""
        return state

    def pose(self, state: Array) -> Pose:
        """The true pose."""
        raise AssertionError(f"{type(self).__name__} must define pose")

    def reported_pose(self, state: Array, pose: Pose, errors: NavigationErrors) -> Pose:
        """The pose that tracker and agent get, given the true one and this instant's errors."""
        return pose


def stack(values: tuple[Number, ...], environments: int) -> Array:
    """Quantities as rows ``(k, N)``."""
    stacked = zeros_for((len(values), environments), *values)
    for row, value in enumerate(values):
        stacked[row] = value
    return stacked
