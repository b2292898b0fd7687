"""What is played: every scenario as it is, and some of them changed in one respect that is worth seeing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from passloc_env.scenario import Scenario
from passloc_env.scenarios import SCENARIOS, find
from passloc_env.tracking import InteractingModels


@dataclass(frozen=True)
class Variant:
    """One section of the board.

    Attributes:
        name: of files and links, e.g. ``BearingsOnly-6mrad``.
        title: for people.
        scenario: what is flown; it keeps the name of the scenario that it was made from.
    """

    name: str
    title: str
    scenario: Scenario


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
    return [Variant(scenario.name, scenario.name, scenario), *changed]
