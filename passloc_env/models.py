"""The matrices and suites that a realised scenario stands for."""

from __future__ import annotations

from collections.abc import Collection

from passloc_env.dynamics import Dynamics
from passloc_env.layout import StateLayout
from passloc_env.motion import Motion
from passloc_env.nuisance import Nuisance
from passloc_env.scenario import Scenario
from passloc_env.sensor_suite import SensorSuite, nuisances
from passloc_env.tracking.tracker import Models


def state_layout(scenario: Scenario, motion: Motion) -> StateLayout:
    """The state of a motion in a scenario: its own rows, then the nuisance states of the sensors."""
    heard = tuple(nuisance.name for nuisance in nuisances(scenario.sensors))
    return motion.layout(scenario.dimension).with_nuisance(heard)


def observation_names(scenario: Scenario) -> tuple[str, ...]:
    """The name of each observation feature, in order."""
    layout = state_layout(scenario, scenario.tracker.motion)
    return scenario.observation.names(layout, scenario.platforms, scenario.own_ship)


class ScenarioModels:
    """What moves and what is heard, three times: in truth, as the tracker believes, and as the bound counts.

    Args:
        realised: the scenario with this episode's numbers.
        random: dotted names of its random quantities.

    Attributes:
        suite: the sensors, shared by all three.
        truth, tracker, bound: state layout and dynamics of each.
        truth_nuisances, tracker_nuisances, bound_nuisances: the nuisance states in each layout.
        volatile: whether matrices hold random numbers, and must be built again when these are drawn anew.
    """

    def __init__(self, realised: Scenario, random: Collection[str]) -> None:
        self._scenario, self._random = realised, random
        self.suite = SensorSuite(realised.sensors, dense=self._is_random("sensors"))
        self.volatile = self._is_random("sensors")
        self.truth, self.truth_nuisances = self._build("target.motion", realised.target.motion)
        self.tracker, self.tracker_nuisances = self._build("tracker.motion", realised.tracker.motion)
        self.bound, self.bound_nuisances = self._build("bound.motion", realised.bound.motion)

    def _is_random(self, prefix: str) -> bool:
        return any(name.startswith(prefix) for name in self._random)

    def _build(self, where: str, motion: Motion) -> tuple[Models, tuple[Nuisance, ...]]:
        layout = state_layout(self._scenario, motion)
        states = motion.nuisances + nuisances(self._scenario.sensors)
        # A walking nuisance of a random sensor sits in every process noise.
        dense = self._is_random(where) or self._is_random("sensors")
        dynamics = Dynamics(motion, layout, self._scenario.episode.period, states, dense=dense)
        self.volatile |= dense and (dynamics.linear or dynamics.noise_size > 0)
        # Random numbers of members are named ``tracker.motions.…``, which begins like their owner's.
        members = tuple(self._build(where, member)[0] for member in motion.members)
        return Models(layout, dynamics, self.suite, members), states
