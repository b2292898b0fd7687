"""States on which a measurement or a motion depends besides the kinematics: an unknown carrier, a bias, a turn rate."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from passloc_env.arrays import Number


@dataclass(frozen=True)
class Nuisance:
    """A further state, unknown beforehand, constant or slowly walking. Whoever names the same nuisance shares it."""

    name: str
    sigma: Number
    """Prior standard deviation; the prior mean is zero."""
    walk: Number = 0.0
    """Random-walk standard deviation per step."""
    unit: str = ""
    """As it is written behind a number; empty for none."""


def distinct(nuisances: Iterable[Nuisance]) -> tuple[Nuisance, ...]:
    """Each nuisance once, by name, as it was first declared."""
    unique: dict[str, Nuisance] = {}
    for nuisance in nuisances:
        unique.setdefault(nuisance.name, nuisance)
    return tuple(unique.values())


def units_of(nuisances: Iterable[Nuisance]) -> dict[str, str]:
    """The unit of each nuisance, by name."""
    return {nuisance.name: nuisance.unit for nuisance in nuisances}
