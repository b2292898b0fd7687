"""Port and starboard: mirrored in the line of sight, a planar problem stays the same problem.

A policy that has learnt one side knows the other. Seen through :class:`MirrorSymmetry` the own ship always moves to
starboard of the line of sight; observations and actions of the other half of the world are mirrored, there and back.
"""

from __future__ import annotations

import numpy as np

from passloc_env.errors import InputError
from passloc_env.models import observation_names
from passloc_env.platforms import TurnLimitedPlatform
from passloc_env.scenario import Scenario

_SIDE = "own velocity across"


class MirrorSymmetry:
    """How the observation features of a planar scenario change in a mirror.

    Args:
        scenario: whose observations are mirrored; all its actions must be those of turn-limited platforms.
        further: names of features that follow the scenario's own.

    Attributes:
        parity: −1 for each feature ``(f,)`` that changes its sign, +1 for the others.

    Raises:
        InputError: a scenario with other actions, in which a mirror does more than change signs.
    """

    def __init__(self, scenario: Scenario, further: tuple[str, ...] = ()) -> None:
        if any(platform.controls and not isinstance(platform, TurnLimitedPlatform) for platform in scenario.platforms):
            raise InputError(f"mirror = True is not possible: {scenario.name} steers more than headings")
        names = observation_names(scenario) + further
        self.parity = np.array([_parity(name) for name in names], np.float32)
        self._side = names.index(_SIDE)

    def sides(self, observation: np.ndarray) -> np.ndarray:
        """+1 where the own ship moves to starboard of the line of sight, −1 where to port, ``(N, 1)``."""
        return np.where(observation[:, self._side] < 0.0, np.float32(-1.0), np.float32(1.0))[:, None]

    def mirrored(self, observation: np.ndarray, sides: np.ndarray) -> np.ndarray:
        """Observations ``(N, f)`` as seen where every own ship moves to starboard."""
        return np.where(sides < 0.0, observation * self.parity, observation)


def _parity(name: str) -> float:
    """Deviations have no side; means, correlations and commands change theirs with every "across" in them."""
    if name.startswith("ln "):
        return 1.0
    odd = name.count("across") + name.count("turn_rate") + name.startswith("last action")
    return -1.0 if odd % 2 else 1.0
