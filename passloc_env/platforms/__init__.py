"""Observers: where they are, how they answer a command, and what they believe about themselves; one kind per file."""

from passloc_env.platforms.circular_orbit import CircularOrbit
from passloc_env.platforms.fixed_station import FixedStation
from passloc_env.platforms.platform import Platform, stack
from passloc_env.platforms.pose import PlanarPose, Pose
from passloc_env.platforms.turn_limited import TurnLimitedPlatform

__all__ = [
    "CircularOrbit",
    "FixedStation",
    "PlanarPose",
    "Platform",
    "Pose",
    "TurnLimitedPlatform",
    "stack",
]
