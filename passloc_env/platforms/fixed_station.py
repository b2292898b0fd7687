"""Stations that stay where they are."""

from __future__ import annotations

from dataclasses import dataclass

from passloc_env.arrays import Array, Number, zeros
from passloc_env.fields import vector
from passloc_env.platforms.platform import Platform, stack
from passloc_env.platforms.pose import Pose


@dataclass(frozen=True, kw_only=True)
class FixedStation(Platform):
    """A station that stays where it is and takes no action; any number of dimensions."""

    position: tuple[Number, ...] = vector("position by axis", (0.0, 0.0), unit="m")

    @property
    def dimension(self) -> int:  # type: ignore[override]
        """As many axes as the position has."""
        return len(self.position)

    def start(self, environments: int) -> Array:
        """The position ``(d, N)``."""
        return stack(self.position, environments)

    def state_at(self, pose: Pose) -> Array:
        """Its position."""
        return pose.position

    def pose(self, state: Array) -> Pose:
        """At rest."""
        still = zeros(state, state.shape)
        return Pose(state, still, still)
