"""What a trajectory optimiser knows and no policy does: the realised future of the emitter, episode by episode."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from gymnasium.vector import AutoresetMode

from passloc_env.arrays import Array, IntArray
from passloc_env.errors import ScenarioError
from passloc_env.layout import StateLayout
from passloc_env.linalg import diagonal
from passloc_env.platforms import PlanarPose, TurnLimitedPlatform
from passloc_env.randomisation import take
from passloc_env.scenario import Scenario
from passloc_env.sensors import Sensor
from passloc_env.simulation import Simulation
from passloc_env.vector_env import LocalisationVectorEnv
from training.optimum.jacobians import check_sensors

EPISODES = 1024
"""Episodes simulated at once; at most a tile of the environment's batch."""


@dataclass(frozen=True)
class Future:
    """Episodes as they will be, whatever the observer does; SI, batch axis last.

    The truth is the realised one: manoeuvres and process noise are those that the environment draws with these seeds.

    Attributes:
        scenario: the problem.
        sensors: with this episode's numbers, arrays ``(N,)`` where they are random.
        layout: the state of the bound.
        truth: in that layout, after each sensor step ``(n, steps, N)``.
        prior: covariance at the truth with which the bound begins ``(n, n, N)``.
        transition: ``F (n, n)`` of the bound per sensor step.
        process_noise: ``Q (n, n, 1|N)`` of the bound.
        sigmas: standard deviation of each measured scalar ``(m, 1|N)``.
        position: where the observer starts ``(2, N)``.
        heading, speed, max_turn_rate: of the observer at the start ``(N,)``; the rate may be infinite.
    """

    scenario: Scenario
    sensors: tuple[Sensor, ...]
    layout: StateLayout
    truth: Array
    prior: Array
    transition: Array
    process_noise: Array
    sigmas: Array
    position: Array
    heading: Array
    speed: Array
    max_turn_rate: Array

    @property
    def episodes(self) -> int:
        """How many."""
        return int(self.truth.shape[-1])

    @property
    def decisions(self) -> int:
        """Decisions per episode."""
        return self.scenario.episode.steps // self.scenario.episode.decision_every

    @property
    def largest_turn(self) -> Array:
        """The most that the observer can turn between two decisions ``(N,)``, rad; infinite where nothing limits it.

        A set-point beyond half a circle would be reached the other way round.
        """
        reach = np.minimum(self.max_turn_rate * self.scenario.episode.interval, 0.999 * np.pi)
        return np.where(np.isinf(self.max_turn_rate), np.inf, reach)

    def take(self, columns: IntArray) -> Future:
        """The future of some episodes, in the order of ``columns``; an episode may be named several times."""
        names = ("truth", "prior", "process_noise", "sigmas", "position", "heading", "speed", "max_turn_rate")
        n = self.episodes
        arrays = {name: getattr(self, name) for name in names}
        taken = {name: values if values.shape[-1] != n else values[..., columns] for name, values in arrays.items()}
        sensors = tuple(take(sensor, columns) for sensor in self.sensors)
        return replace(self, sensors=sensors, **taken)


def foresee(scenario: Scenario, seeds: Sequence[int]) -> Future:
    """The future of the episodes that the environment begins with ``seeds``, at most :data:`EPISODES` of them.

    Raises:
        ScenarioError: a scenario that :func:`check` refuses.
    """
    check(scenario)
    unending = scenario.override({"episode.early_end": False})
    env = LocalisationVectorEnv(len(seeds), unending, autoreset_mode=AutoresetMode.DISABLED)
    (world,) = env.batch.tiles
    env.reset(seed=[int(seed) for seed in seeds])
    prior, pose = world.information.bound.copy(), world.poses()[0]
    assert isinstance(pose, PlanarPose)
    position, heading = pose.position.copy(), pose.heading.copy()
    states: list[Array] = []

    def watch(simulation: Simulation) -> None:
        states.append(simulation.bound_scene().state.copy())

    world.watchers.append(watch)
    idle = np.zeros((len(seeds), scenario.action_size))
    for _ in range(scenario.episode.steps // scenario.episode.decision_every):
        env.step(idle)

    platform, bound = world.realised.platforms[0], world.models.bound
    assert isinstance(platform, TurnLimitedPlatform)
    ones = np.ones(len(seeds))
    return Future(
        scenario=scenario,
        sensors=world.realised.sensors,
        layout=bound.layout,
        truth=np.stack(states, axis=1),
        prior=prior,
        transition=bound.dynamics.transition.matrix[..., 0],
        process_noise=bound.dynamics.process_noise,
        sigmas=np.sqrt(diagonal(world.models.suite.noise_covariance)),
        position=position,
        heading=heading,
        speed=platform.speed * ones,
        max_turn_rate=platform.max_turn_rate * ones,
    )


def check(scenario: Scenario) -> None:
    """Raise ScenarioError, in one line, for problems whose optimum is beyond this package."""
    platform = scenario.platforms[0]
    if len(scenario.platforms) > 1 or not isinstance(platform, TurnLimitedPlatform):
        kinds = ", ".join(type(each).__name__ for each in scenario.platforms)
        raise ScenarioError("platforms", kinds, "the trajectory optimum needs one TurnLimitedPlatform")
    if platform.control != "heading":
        raise ScenarioError("platforms.0.control", platform.control, "the trajectory optimum needs control 'heading'")
    check_sensors(scenario.sensors)
