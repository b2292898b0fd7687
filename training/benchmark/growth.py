"""What a sensor step costs in every scenario, and how that grows with states, sensors and the length of episodes."""

from __future__ import annotations

import itertools

import numpy as np

from passloc_env import SCENARIOS, LocalisationVectorEnv, Scenario
from training.benchmark.harness import VectorCandidate, run_in_turns
from training.benchmark.report import Cost, Growth, spread

_DOPPLER = SCENARIOS["BearingDoppler"]

VARIANTS: dict[str, Scenario] = {
    "6 states": _DOPPLER.override({"tracker.motion": {"type": "ConstantAcceleration", "acceleration_noise": 0.5}}),
    "1 sensor": _DOPPLER.replace(sensors=_DOPPLER.sensors[:1]),
    "3 sensors": _DOPPLER.replace(sensors=(*_DOPPLER.sensors, _DOPPLER.sensors[0])),
    "4 sensors": _DOPPLER.replace(sensors=_DOPPLER.sensors * 2),
    "60 steps": _DOPPLER.override({"episode.steps": 60}),
    "960 steps": _DOPPLER.override({"episode.steps": 960}),
}
"""BearingDoppler (four states, two sensors, 240 steps) with one thing changed."""


def measure_growth(environments: int, rounds: int, seconds: float) -> Growth:
    """Every scenario and every variant of BearingDoppler, in turns.

    Args:
        environments: of each.
        rounds: how often each has its turn.
        seconds: wall time of each turn at least, s.
    """
    named = {**SCENARIOS, **{f"BearingDoppler, {what}": scenario for what, scenario in VARIANTS.items()}}
    random = np.random.default_rng(0)
    candidates = [VectorCandidate(scenario, environments, random) for scenario in named.values()]
    turns = run_in_turns(candidates, rounds, seconds)
    costs = [
        Cost(
            name,
            states=len(candidate.env.belief.mean),
            scalars=candidate.env.batch.tiles[0].models.suite.size,
            steps=scenario.episode.steps,
            microseconds=spread([1e6 / slice_.per_cpu_second for slice_ in own]),
            kilobytes=memory(candidate.env) / environments / 1e3,
        )
        for (name, scenario), candidate, own in zip(named.items(), candidates, turns, strict=True)
    ]
    return Growth(environments, rounds, costs)


def memory(env: LocalisationVectorEnv) -> int:
    """Bytes of all that a batch keeps: state, and the noise of whole episodes."""
    arrays = itertools.chain.from_iterable(tile.state_arrays().values() for tile in env.batch.tiles)
    return sum(array.nbytes for array in arrays)
