"""The matrices and suites that a realised scenario stands for."""

from __future__ import annotations

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


class ScenarioModels:
    """What moves and what is heard, three times: in truth, as the tracker believes, and as the bound counts.

    Attributes:
        suite: the sensors, shared by all three.
        truth, tracker, bound: state layout and dynamics of each.
        truth_nuisances, tracker_nuisances, bound_nuisances: the nuisance states in each layout.
    """

    def __init__(self, realised: Scenario, dense: bool) -> None:
        self._scenario, self._dense = realised, dense
        self.suite = SensorSuite(realised.sensors, dense=dense)
        self.truth, self.truth_nuisances = self._build(realised.target.motion)
        self.tracker, self.tracker_nuisances = self._build(realised.tracker.motion)
        self.bound, self.bound_nuisances = self._build(realised.bound.motion)

    def _build(self, motion: Motion) -> tuple[Models, tuple[Nuisance, ...]]:
        layout = state_layout(self._scenario, motion)
        states = motion.nuisances + nuisances(self._scenario.sensors)
        dynamics = Dynamics(motion, layout, self._scenario.episode.period, states, dense=self._dense)
        return Models(layout, dynamics, self.suite), states
