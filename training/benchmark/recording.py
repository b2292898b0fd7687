"""An episode's measurements, for filters that are timed without an environment around them."""

from __future__ import annotations

import copy
import math
from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from passloc_env import Scenario
from passloc_env.platforms import TurnLimitedPlatform
from training.benchmark.peer_tracking import doppler_scale, measurement_noise
from training.benchmark.peer_world import Emitter, OwnShip, draw


@dataclass(frozen=True)
class Look:
    """One measurement, absolute bearing (rad) and Doppler shift (Hz), made by whom, and where the emitter was (m)."""

    own: OwnShip
    bearing: float
    shift: float
    emitter: tuple[float, float]


def record(scenario: Scenario, random: np.random.Generator) -> list[Look]:
    """The first look and all measurements of an episode flown with random headings."""
    chance, own_platform = draw(scenario, random), scenario.platforms[0]
    assert isinstance(own_platform, TurnLimitedPlatform)
    emitter, own = Emitter(chance), OwnShip(chance, float(own_platform.max_turn_rate))
    noise = chance.noise @ np.sqrt(measurement_noise(scenario))
    episode, scale = scenario.episode, doppler_scale(scenario)
    looks = []
    for step in range(episode.steps + 1):
        if step:
            own.move(episode.period)
            emitter.move((step - 1) * episode.period, episode.period)
        x, y = emitter.east - own.east, emitter.north - own.north
        (v_east, v_north), (own_east, own_north) = emitter.velocity, own.velocity
        rate = (x * (v_east - own_east) + y * (v_north - own_north)) / math.hypot(x, y)
        looks.append(
            Look(
                copy.copy(own),
                math.atan2(x, y) + noise[step, 0],
                scale * rate + noise[step, -1],
                (emitter.east, emitter.north),
            )
        )
        if step % episode.decision_every == 0:
            own.set_point = random.uniform(-math.pi, math.pi)
    return looks


class Replayed(ABC):
    """A candidate of the benchmark that hears one recording again and again.

    Args:
        scenario: what is recorded.
        random: chance.
    """

    environments = 1

    def __init__(self, scenario: Scenario, random: np.random.Generator) -> None:
        self.looks = record(scenario, random)
        self._next = 0

    @abstractmethod
    def start(self, look: Look) -> None:
        """Begin to track from the first look."""

    @abstractmethod
    def hear(self, look: Look) -> None:
        """A prediction and an update."""

    def warm_up(self) -> None:
        """One recording."""
        for _ in self.looks:
            self.step()

    def step(self) -> int:
        """One measurement; the recording's first look only starts the track."""
        if self._next == 0:
            self.start(self.looks[0])
            self._next = 1
        self.hear(self.looks[self._next])
        self._next = (self._next + 1) % len(self.looks)
        return 1
