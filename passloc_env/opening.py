"""What an episode begins with: how much chance it needs, and where the emitter is."""

from __future__ import annotations

from passloc_env.arrays import Array, IntArray, zeros
from passloc_env.models import ScenarioModels
from passloc_env.noise import NoiseSizes
from passloc_env.randomisation import take
from passloc_env.scenario import Scenario
from passloc_env.sensor_suite import may_fail, may_miss


def noise_sizes(scenario: Scenario, models: ScenarioModels, quantities: int) -> NoiseSizes:
    """The random numbers of an episode, with so many ``quantities`` that may be random."""
    return NoiseSizes(
        uniforms=quantities,
        prior=scenario.prior.normals_needed(models.tracker.layout),
        nuisances=len(models.truth_nuisances),
        steps=scenario.episode.steps,
        measurement=models.suite.size,
        process=models.truth.dynamics.noise_size,
        detection=len(scenario.sensors) if may_miss(scenario.sensors) else 0,
        navigation=tuple((platform.constant_errors, platform.fresh_errors) for platform in scenario.platforms),
        uniform=models.suite.uniform,
        fault=2 * len(scenario.sensors) if may_fail(scenario.sensors) else 0,
    )


def first_truth(realised: Scenario, models: ScenarioModels, columns: IntArray, normals: Array) -> Array:
    """The true state ``(n, k)`` at the beginning of the episodes of some environments.

    Args:
        realised: the scenario with the numbers of all environments.
        models: what it stands for.
        columns: which environments.
        normals: standard normals for the true nuisances, one row each ``(m, k)``.
    """
    layout = models.truth.layout
    truth = zeros(normals, (layout.size, len(columns)))
    start = take(realised.target.start, columns).sample(len(columns))
    given = min(len(start), layout.kinematic.stop)
    truth[:given] = start[:given]
    for nuisance, normal in zip(models.truth_nuisances, normals, strict=True):
        truth[layout.nuisance_row(nuisance.name)] = nuisance.sigma * normal
    return truth
