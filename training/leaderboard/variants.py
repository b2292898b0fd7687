"""What is played: every scenario as it is, and some of them changed in one respect that is worth seeing."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from passloc_env.distributions import Uniform
from passloc_env.platforms import TurnLimitedPlatform
from passloc_env.scenario import Scenario
from passloc_env.scenarios import SCENARIOS, find
from passloc_env.target import CartesianStart, PolarStart
from passloc_env.tracking import InteractingModels


@dataclass(frozen=True)
class Variant:
    """One section of the board.

    Attributes:
        name: of files and links, e.g. ``BearingsOnly-6mrad``.
        title: for people.
        scenario: what is flown; it keeps the name of the scenario that it was made from.
        family: whether it is a family around a fixed case.
    """

    name: str
    title: str
    scenario: Scenario
    family: bool = False


_CHANGES: dict[str, tuple[tuple[str, str, Mapping[str, Any]], ...]] = {
    "BearingsOnly": (
        ("1mrad", "bearings to 1 mrad", {"sensors.Bearing.sigma": 1e-3}),
        ("6mrad", "bearings to 6 mrad", {"sensors.Bearing.sigma": 6e-3}),
        ("17mrad", "bearings to 17 mrad", {"sensors.Bearing.sigma": 17e-3}),
    ),
    "BearingDoppler": (("IMM", "tracked by interacting models", {"tracker": InteractingModels()}),),
}
"""Changes by scenario: a suffix, words for it, and the fields that change."""


def variants(names: str = "") -> tuple[Variant, ...]:
    """The variants of some scenarios, in the order of the catalogue.

    Args:
        names: scenarios separated by commas; all when empty.

    Raises:
        ScenarioError: no such scenario, with the closest name.
    """
    wanted = [find(name.strip()).name for name in names.split(",")] if names else list(SCENARIOS)
    return tuple(variant for name, scenario in SCENARIOS.items() if name in wanted for variant in _of(scenario))


def _of(scenario: Scenario) -> Sequence[Variant]:
    changed = [
        Variant(f"{scenario.name}-{suffix}", f"{scenario.name}, {words}", scenario.override(changes))
        for suffix, words, changes in _CHANGES.get(scenario.name, ())
    ]
    around = family(scenario)
    if around:
        words = f"{scenario.name}, a family around it"
        changed.append(Variant(f"{scenario.name}-family", words, scenario.override(around), family=True))
    return [Variant(scenario.name, scenario.name, scenario), *changed]


def family(scenario: Scenario) -> dict[str, Any]:
    """What changes from a single fixed geometry to a family around it; nothing where there is none.

    Half to twice the range and the speed, any bearing and course, any own heading, 0.7 to 1.5 times the noise.
    """
    start, own = scenario.target.start, scenario.platforms[scenario.own_ship]
    if not isinstance(start, CartesianStart) or not isinstance(own, TurnLimitedPlatform):
        return {}
    numbers = (*start.position, *start.velocity, own.heading)
    if start.dimension != 2 or not all(isinstance(number, float) for number in numbers):
        return {}
    anywhere = Uniform(low=-math.pi, high=math.pi)
    away, speed = math.hypot(*start.position), math.hypot(*start.velocity)
    around = PolarStart(
        range=_around(away, 0.5, 2.0), bearing=anywhere, speed=_around(speed, 0.5, 2.0), course=anywhere
    )
    sigmas = {f"sensors.{index}.sigma": getattr(sensor, "sigma", None) for index, sensor in enumerate(scenario.sensors)}
    noise = {name: _around(sigma, 0.7, 1.5) for name, sigma in sigmas.items() if isinstance(sigma, float)}
    return {"target.start": around, f"platforms.{scenario.own_ship}.heading": anywhere, **noise}


def _around(value: float, low: float, high: float) -> Uniform:
    return Uniform(low=low * value, high=high * value)
