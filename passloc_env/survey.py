"""What an episode's path lets one know: Gramian, rank and bound of a scenario along any trajectory.

One episode is flown and looked at from the outside: its true geometry, the Fisher rows of every measurement, and the
bound. The same path is then asked what it would have told about emitters elsewhere.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from passloc_env.arrays import Array
from passloc_env.belief import Belief
from passloc_env.checks import require_exactly, require_shape
from passloc_env.dynamics import Dynamics
from passloc_env.linalg import diagonal
from passloc_env.metrics import root_trace
from passloc_env.observability import RankReport, cramer_rao_path, fisher_rows, gramian, rank_report
from passloc_env.platforms import Pose
from passloc_env.scenario import Scenario
from passloc_env.sensor_suite import Arrival
from passloc_env.sightline import Scene
from passloc_env.simulation import Simulation
from passloc_env.tracking.initialisation import FirstLook

Helmsman = Callable[[np.ndarray, Belief, np.random.Generator], np.ndarray]
"""Who flies: observation, belief and random numbers to actions ``(N, a)``, as ``Policy.act`` does."""

_CELLS = 512
"""Emitters elsewhere that are looked at together."""


class Survey:
    """One episode, flown to its end and looked at from the outside.

    Args:
        scenario: the problem.
        helmsman: who flies; None keeps every command neutral.
        seed: of the episode.

    Attributes:
        time: of every measurement ``(K,)``, s.
        start: true state of the emitter before the first one, in the state of the bound ``(n, 1)``.
        states: true states at every measurement ``(K, n)``.
        path: at every measurement, the true pose of each platform.
        rows: Fisher rows ``R^{-1/2} H`` of every measurement ``(K, m, n, 1)``.
        prior: covariance that the bound starts from ``(n, n, 1)``.
        bound: the bound after every measurement ``(K, n, n)``.
    """

    def __init__(self, scenario: Scenario, helmsman: Helmsman | None = None, seed: int = 0) -> None:
        self.scenario = scenario.override({"episode.early_end": False})
        self.simulation = Simulation(self.scenario, 1)
        self.simulation.reset(np.arange(1), [np.random.default_rng(seed)])
        self.layout = self.simulation.models.bound.layout
        self.start = self.simulation.bound_scene().state.copy()
        self.prior = self.simulation.information.bound.copy()
        self._first_poses, self._first_chances = self._poses(self.simulation), self._chances(self.simulation)
        self.path: list[list[Pose]] = []
        self._uniforms: list[Array | None] = []
        self._inflations: list[Array | None] = []
        self._rows: list[Array] = []
        self._states: list[Array] = []
        self._bounds: list[Array] = []
        self.simulation.watchers.append(self._watch)
        rng = np.random.default_rng(seed)
        for _ in range(self.scenario.episode.steps // self.scenario.episode.decision_every):
            actions = np.zeros((1, self.scenario.action_size))
            if helmsman is not None:
                observation = self.simulation.observe().T.astype(np.float32)
                actions = helmsman(observation, self.simulation.belief, rng)
            self.simulation.step(np.ascontiguousarray(actions.T, float))
        self.rows, self.states, self.bound = np.stack(self._rows), np.stack(self._states), np.stack(self._bounds)
        self.time = self.scenario.episode.period * np.arange(1, len(self.path) + 1)

    def _watch(self, simulation: Simulation) -> None:
        scene, suite = simulation.bound_scene(), simulation.models.suite
        self.path.append(self._poses(simulation))
        self._uniforms.append(self._chances(simulation))
        self._inflations.append(self._inflation(simulation))
        self._states.append(scene.state[:, 0].copy())
        heard = suite.detected(simulation.scene(), self._uniforms[-1])
        self._rows.append(fisher_rows(suite, scene, heard, self._inflations[-1]))
        self._bounds.append(simulation.information.bound[..., 0].copy())

    @staticmethod
    def _poses(simulation: Simulation) -> list[Pose]:
        """The poses as they are now; the live ones change with the next step."""
        platforms = zip(simulation.realised.platforms, simulation.platform_states, strict=True)
        return [platform.pose(state.copy()) for platform, state in platforms]

    @staticmethod
    def _chances(simulation: Simulation) -> Array | None:
        """What decides which sensors miss by chance now ``(s, 1)``; None when none can.

        What comes late counts where it was measured, but at the end, when it comes too late.
        """
        arrival: Arrival = "in time" if simulation.truncated[0] else "ever"
        return simulation.models.suite.chances(simulation.noise_at(), simulation.time, arrival)

    @staticmethod
    def _inflation(simulation: Simulation) -> Array | None:
        """How many times as wide as usual each error is now ``(m, 1)``; None where there are no outliers."""
        return simulation.models.suite.inflation(simulation.noise_at().fault)

    @property
    def dynamics(self) -> Dynamics:
        """The motion model of the bound."""
        return self.simulation.models.bound.dynamics

    @property
    def gramian(self) -> Array:
        """Fisher information of the first measurement's state, without prior and process noise ``(n, n)``."""
        return gramian(self.rows, self.dynamics.transition.matrix)[..., 0]

    def rank(self, tolerance: float = 1e-9) -> RankReport:
        """Rank, condition and weakest direction of the record, the state in units of the prior's deviations."""
        scale = np.sqrt(diagonal(self.prior)[:, 0])
        return rank_report(self.rows, self.dynamics.transition.matrix, self.layout, scale, tolerance)

    @property
    def position_bound(self) -> Array:
        """Root of the trace of the bound's position block after every measurement ``(K,)``, m."""
        return root_trace(np.moveaxis(self.bound, 0, -1), self.layout.position)

    @property
    def range(self) -> Array:
        """True range from the own ship ``(K,)``, m."""
        own = np.stack([poses[self.scenario.own_ship].position[:, 0] for poses in self.path])
        separation: Array = np.linalg.norm(self.states[:, self.layout.position] - own, axis=1)
        return separation

    def bound_elsewhere(self, positions: Array) -> Array:
        """What the same path would come to for emitters that start elsewhere, with the same velocity.

        What was missed by chance is missed there too, and outliers are outliers; what is hidden depends on where they
        are.

        Args:
            positions: where they start ``(d, N)``, m.

        Returns:
            Root of the trace of the bound's position block at the end of the episode ``(N,)``, m.

        Raises:
            InputError: positions of another shape or not finite.
        """
        places = require_shape("positions", positions, 2, "axes and emitters")
        require_exactly("positions", places, (self.layout.dimension, places.shape[1]))
        cells = range(0, places.shape[1], _CELLS)
        return np.concatenate([self._bound_of(places[:, first : first + _CELLS]) for first in cells])

    def _bound_of(self, positions: Array) -> Array:
        start = np.repeat(self.start, positions.shape[1], axis=1)
        start[self.layout.position] = positions
        suite = self.simulation.models.suite
        look = FirstLook(
            layout=self.layout,
            truth=start,
            measurement=np.zeros((suite.size, positions.shape[1])),
            suite=suite,
            poses=self._first_poses,
            normals=np.zeros((0, positions.shape[1])),
            nuisances=self.simulation.models.bound_nuisances,
            carrier=self.scenario.prior.carrier_platform(self.scenario.sensors),
            detected=suite.detected(Scene(start, self.layout, self._first_poses), self._first_chances),
        )
        prior = np.broadcast_to(self.simulation.realised.prior.at_truth(look), (*self.prior.shape[:2], start.shape[1]))
        bounds = cramer_rao_path(self.dynamics, suite, start, prior, self.path, self._uniforms, self._inflations)
        return root_trace(bounds[-1], self.layout.position)
