"""A leg of a soak: a scenario that chance has made, the batch it is flown in, and how it is steered.

Numbers of a scenario are multiplied by up to ten or divided by as much, sensors fail in all their ways, another tracker
takes over; what the scenario refuses is left as it was. A leg depends on the soak's seed and its own number alone.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from passloc_env import SCENARIOS
from passloc_env.component import Component, specs, to_dict
from passloc_env.distributions import Distribution, LogUniform, Uniform
from passloc_env.errors import ScenarioError
from passloc_env.fields import Part, Parts, Quantity
from passloc_env.scenario import Scenario

_TRACKERS = (
    "UnscentedKalman",
    "ExtendedKalman",
    "SquareRootKalman",
    "RangeBank",
    "InteractingModels",
    "CrossingKalman",
    "RecursiveCrossFix",
    "FilterPyTracker",
)
_GATES = (0.0, 0.9, 0.99, 0.999)
_MODES = ("NextStep", "SameStep")
_CHANGED = 0.2
"""Share of the numbers of a scenario that are changed."""

_MOST = 4096
_MOST_BY_FILTERPY = 2
"""Environments of a leg at most; filters in Python are slow."""


class Leg(NamedTuple):
    """What is flown.

    Attributes:
        number: of the leg.
        scenario: as chance has made it.
        environments: how many.
        mode: how finished environments begin anew.
        helm: from 0, where actions are random, to 1, where each is an extreme.
        rng: what draws the actions and the first seed.
    """

    number: int
    scenario: Scenario
    environments: int
    mode: str
    helm: float
    rng: np.random.Generator

    def actions(self) -> np.ndarray:
        """Those of one decision ``(N, a)``."""
        size = (self.environments, self.scenario.action_size)
        extreme = self.rng.choice([-1.0, 0.0, 1.0, 1e30], size)
        return np.where(self.rng.random(size) < self.helm, extreme, self.rng.uniform(-1.0, 1.0, size))


def draw(seed: int, number: int, most: int = _MOST) -> Leg:
    """A leg of at most so many environments; the scenarios come in turns."""
    rng = np.random.default_rng([seed, number])
    scenario = list(SCENARIOS.values())[number % len(SCENARIOS)]
    scenario = _with(scenario, _length(scenario, rng) | {"episode.early_end": bool(rng.random() < 0.5)})
    for name, value in _numbers(scenario, "", rng):
        scenario = _with(scenario, {name: value})
    for index in range(len(scenario.sensors)):
        scenario = _with(scenario, _faults(scenario, f"sensors.{index}", rng))
    scenario = _with(scenario, {"tracker": _tracker(scenario, rng)})
    most = _MOST_BY_FILTERPY if type(scenario.tracker).__name__ == "FilterPyTracker" else most
    environments = int((most + 1) ** np.sqrt(rng.random()))
    return Leg(number, scenario, environments, str(rng.choice(_MODES)), float(rng.random()), rng)


def _with(scenario: Scenario, changes: dict[str, Any]) -> Scenario:
    """A scenario with some changes, or as it was where it refuses them."""
    try:
        return scenario.override(changes)
    except ScenarioError:
        return scenario


def _length(scenario: Scenario, rng: np.random.Generator) -> dict[str, Any]:
    every = int(rng.integers(1, 6))
    longest = max(1, scenario.episode.steps // every)
    return {"episode.decision_every": every, "episode.steps": every * int(rng.integers(1, min(longest, 60) + 1))}


def _numbers(component: Component, where: str, rng: np.random.Generator) -> Iterator[tuple[str, Any]]:
    """New values of some numbers of a component and its parts, by dotted name."""
    for name, spec in specs(type(component)).items():
        value, path = getattr(component, name), f"{where}{name}"
        if isinstance(spec, Part):
            yield from _numbers(value, f"{path}.", rng)
        elif isinstance(spec, Parts):
            for index, item in enumerate(value):
                yield from _numbers(item, f"{path}.{index}.", rng)
        elif isinstance(spec, Quantity) and rng.random() < _CHANGED:
            yield path, _changed(value, spec, rng)


def _changed(value: Any, spec: Quantity, rng: np.random.Generator) -> Any:
    """A number or a distribution up to ten times as large or as small; for a zero with limits, any between them."""
    factor = 10.0 ** rng.uniform(-1.0, 1.0)
    if isinstance(value, (Uniform, LogUniform)):
        return dataclasses.replace(value, low=factor * value.low, high=factor * value.high)
    if isinstance(value, Distribution):
        return value
    if value == 0.0 and spec.at_most is not None:
        return float(rng.uniform(0.0, spec.at_most))
    return factor * value if spec.at_most is None else min(factor * value, spec.at_most)


def _faults(scenario: Scenario, sensor: str, rng: np.random.Generator) -> dict[str, Any]:
    if rng.random() < 0.5:
        return {}
    duration = scenario.episode.duration
    return {
        f"{sensor}.detection_probability": float(rng.uniform(0.2, 1.0)),
        f"{sensor}.faults": {
            "outlier_probability": float(rng.uniform(0.0, 0.3)),
            "outlier_scale": 10.0 ** rng.uniform(0.0, 2.0),
            "late_probability": float(rng.uniform(0.0, 0.3)),
            "outage_start": Uniform(low=0.0, high=duration),
            "outage_duration": float(rng.uniform(0.0, 0.5 * duration)),
        },
    }


def _tracker(scenario: Scenario, rng: np.random.Generator) -> Any:
    """The scenario's own tracker, or another that believes in the same motion; gated or not."""
    kind = str(rng.choice([type(scenario.tracker).__name__, *_TRACKERS]))
    gate = {"gate": float(rng.choice(_GATES))} if "gate" in specs(Component.registry[kind]) else {}
    if kind == type(scenario.tracker).__name__:
        return to_dict(scenario.tracker) | gate
    motion = {} if kind == "InteractingModels" else {"motion": scenario.tracker.motion}
    return {"type": kind, **motion, **gate}
