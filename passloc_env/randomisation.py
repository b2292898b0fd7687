"""Domain randomisation: scenario quantities given as distributions, sampled per environment at reset."""

from __future__ import annotations

import copy
from collections.abc import Callable
from typing import Any

import numpy as np

from passloc_env.arrays import Array, IntArray
from passloc_env.component import Component, specs
from passloc_env.distributions import Distribution
from passloc_env.fields import Part, Parts, Quantity, Vector


class Randomisation:
    """A scenario whose distributions have become arrays ``(N,)``, refilled in place at every reset.

    Every quantity of the scenario, random or not, owns one uniform draw per episode, so that making one of them random
    never shifts the numbers of another. Those that are appended come last.

    Attributes:
        realised: the component with arrays in place of distributions.
        size: uniform draws per episode.
        random: dotted names of the random quantities, list positions left out.
    """

    def __init__(self, component: Component, environments: int) -> None:
        self._environments = environments
        self._slots: list[tuple[int, Distribution, Array]] = []
        self.size = 0
        self.random: set[str] = set()
        self._appended: list[tuple[Any, str, str]] = []
        self.realised = self._realise(component, "")
        for owner, name, where in self._appended:
            object.__setattr__(owner, name, self._slot(getattr(owner, name), where))

    def sample(self, columns: IntArray, uniforms: Array) -> None:
        """Draw new numbers for the given environments from standard uniforms ``(size, k)``."""
        for index, distribution, values in self._slots:
            values[columns] = distribution.sample(uniforms[index])

    def state_arrays(self) -> dict[str, np.ndarray]:
        """The numbers in force, by slot."""
        return {str(index): values for index, _, values in self._slots}

    def _realise(self, component: Component, path: str) -> Any:
        realised = copy.copy(component)
        for name, spec in specs(type(component)).items():
            value, where = getattr(component, name), f"{path}{name}"
            if isinstance(spec, Quantity) and spec.appended:
                self._appended.append((realised, name, where))
            elif isinstance(spec, Quantity):
                value = self._slot(value, where)
            elif isinstance(spec, Vector):
                value = tuple(self._slot(item, where) for item in value)
            elif isinstance(spec, Part):
                value = self._realise(value, f"{where}.")
            elif isinstance(spec, Parts):
                value = tuple(self._realise(item, f"{where}.") for item in value)
            object.__setattr__(realised, name, value)
        return realised

    def _slot(self, value: Any, where: str) -> Any:
        index = self.size
        self.size += 1
        if not isinstance(value, Distribution):
            return value
        values = np.full(self._environments, value.support[1])
        self._slots.append((index, value, values))
        self.random.add(where)
        return values


def join(components: list[Any]) -> Any:
    """One realised component from the same component of several batches, their arrays put end to end."""
    return _combine(components, lambda values: np.concatenate(values))


def take(component: Any, columns: IntArray) -> Any:
    """A realised component as it stands in some environments only."""
    return _combine([component], lambda values: values[0][columns])


def _combine(components: list[Any], numbers: Callable[[list[Array]], Array]) -> Any:
    """The component whose per-environment numbers are made from those of others like it."""

    def combined(values: list[Any]) -> Any:
        return numbers(values) if isinstance(values[0], np.ndarray) else values[0]

    result = copy.copy(components[0])
    for name, spec in specs(type(result)).items():
        values = [getattr(component, name) for component in components]
        if isinstance(spec, Quantity):
            value = combined(values)
        elif isinstance(spec, Vector):
            value = tuple(combined(list(items)) for items in zip(*values, strict=True))
        elif isinstance(spec, Part):
            value = _combine(values, numbers)
        elif isinstance(spec, Parts):
            value = tuple(_combine(list(items), numbers) for items in zip(*values, strict=True))
        else:
            continue
        object.__setattr__(result, name, value)
    return result
