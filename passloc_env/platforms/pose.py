"""Where a platform is and which way it points."""

from __future__ import annotations

from typing import Any

import numpy as np

from passloc_env.angles import direction
from passloc_env.arrays import Array, BoolArray, Number, numbers, rows, zeros
from passloc_env.lazy import lazy


class Pose:
    """Position, velocity, acceleration and attitude of a platform, each ``(d, N)``; SI.

    ``attitude (d, d, N)`` holds the body axes as rows (forward first), ``attitude_rate`` its time derivative.
    """

    def __init__(
        self,
        position: Array,
        velocity: Array,
        acceleration: Array | None = None,
        attitude: Array | None = None,
        attitude_rate: Array | None = None,
    ) -> None:
        self.position, self.velocity = position, velocity
        given = {"acceleration": acceleration, "attitude": attitude, "attitude_rate": attitude_rate}
        self.__dict__.update({name: value for name, value in given.items() if value is not None})

    @classmethod
    def join(cls, poses: list[Any]) -> Pose:
        """The poses of several batches put end to end."""
        names = ("position", "velocity", "acceleration", "attitude", "attitude_rate")
        return cls(*(np.concatenate([getattr(pose, name) for pose in poses], axis=-1) for name in names))

    @lazy
    def acceleration(self) -> Array:
        """``(d, N)``, m/s²; zero unless the platform says otherwise."""
        return zeros(self.position, self.position.shape)

    @lazy
    def attitude(self) -> Array:
        """Body axes as rows ``(d, d, N)``; the axes of the frame unless the platform says otherwise."""
        d, n = self.position.shape
        return np.broadcast_to(np.eye(d)[..., None], (d, d, n))

    @lazy
    def attitude_rate(self) -> Array:
        """Time derivative of :attr:`attitude`, rad/s."""
        return zeros(self.position, (len(self.position), *self.position.shape))

    def hidden(self, point: Array) -> BoolArray | None:
        """Which points ``(d, N)`` the surroundings hide from here ``(N,)``; None where nothing ever hides."""
        return None

    def mounted(self, lever_arm: tuple[Number, ...]) -> Pose:
        """The pose of a point of the body, ``lever_arm`` given along the body axes, m.

        The point takes part in the body's rotation; its centripetal acceleration is that of a steady rotation.
        """
        if not lever_arm:
            return self
        arms = [numbers(arm) for arm in lever_arm]
        attitude, rate = self.attitude, self.attitude_rate
        position, velocity, acceleration = self.position + 0.0, self.velocity + 0.0, self.acceleration + 0.0
        for axis, arm in enumerate(arms):
            position += arm * attitude[axis]
            velocity += arm * rate[axis]
            for other in range(len(attitude)):
                projection = sum(rate[axis, k] * attitude[other, k] for k in range(len(attitude)))
                acceleration += arm * projection * rate[other]
        return Pose(position, velocity, acceleration, attitude, rate)


class PlanarPose(Pose):
    """A pose in the plane whose body points along its heading."""

    def __init__(self, position: Array, velocity: Array, heading: Array, turn_rate: Array) -> None:
        super().__init__(position, velocity)
        self.heading, self.turn_rate = heading, turn_rate

    @classmethod
    def join(cls, poses: list[Any]) -> PlanarPose:
        """The poses of several batches put end to end."""
        names = ("position", "velocity", "heading", "turn_rate")
        return cls(*(np.concatenate([getattr(pose, name) for pose in poses], axis=-1) for name in names))

    @lazy
    def acceleration(self) -> Array:
        """That of the turn: rate times speed, to starboard ``(2, N)``."""
        return self.turn_rate * rows(self.velocity[1], -self.velocity[0])

    @lazy
    def attitude(self) -> Array:
        """Forward and starboard axes as rows ``(2, 2, N)``."""
        forward = direction(self.heading)
        return rows(forward, rows(forward[1], -forward[0]))

    @lazy
    def attitude_rate(self) -> Array:
        """Time derivative of the axes: forward turns towards starboard, starboard towards aft."""
        forward, starboard = self.attitude
        return rows(self.turn_rate * starboard, -self.turn_rate * forward)
