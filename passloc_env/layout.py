"""Which rows of a state vector are position, velocity, acceleration and nuisance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

from passloc_env.arrays import Array, zeros


@dataclass(frozen=True)
class StateLayout:
    """The rows of a state vector: position block, velocity block, acceleration block if any, then nuisances.

    Nobody indexes a state by number: ``state[layout.position]`` is a view ``(d, …, N)``.

    Args:
        dimension: number of spatial axes (2: east, north; 3: a Cartesian frame).
        order: highest time derivative held, 1 velocity or 2 acceleration.
        nuisance: names of further states, e.g. an unknown carrier.
    """

    dimension: int = 2
    order: int = 1
    nuisance: tuple[str, ...] = ()

    @cached_property
    def position(self) -> slice:
        """Rows of the position, m."""
        return slice(0, self.dimension)

    @cached_property
    def velocity(self) -> slice:
        """Rows of the velocity, m/s."""
        return slice(self.dimension, 2 * self.dimension)

    @cached_property
    def acceleration(self) -> slice:
        """Rows of the acceleration, m/s²; empty for layouts of order 1."""
        return slice(2 * self.dimension, 3 * self.dimension if self.order > 1 else 2 * self.dimension)

    @cached_property
    def kinematic(self) -> slice:
        """Rows of position and its derivatives."""
        return slice(0, self.dimension * (self.order + 1))

    @cached_property
    def size(self) -> int:
        """Number of rows."""
        return self.dimension * (self.order + 1) + len(self.nuisance)

    @cached_property
    def nuisances(self) -> slice:
        """Rows of all nuisance states."""
        return slice(self.kinematic.stop, self.size)

    def nuisance_row(self, name: str) -> int:
        """Row of one nuisance state; KeyError when the layout has none of that name."""
        if name not in self.nuisance:
            raise KeyError(f"no nuisance state {name!r}; known: {', '.join(self.nuisance) or 'none'}")
        return self.kinematic.stop + self.nuisance.index(name)

    def with_nuisance(self, names: tuple[str, ...]) -> StateLayout:
        """The same layout with further nuisance states appended."""
        return StateLayout(self.dimension, self.order, self.nuisance + names)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """A name for each row, e.g. ``("east", "north", "east velocity", …)``."""
        axes = ("east", "north", "up")[: self.dimension] if self.dimension == 2 else ("x", "y", "z")[: self.dimension]
        derivatives = ("", " velocity", " acceleration")[: self.order + 1]
        return tuple(axis + derivative for derivative in derivatives for axis in axes) + self.nuisance

    def units(self, nuisance_units: Mapping[str, str]) -> tuple[str, ...]:
        """The unit of each row, e.g. ``("m", "m", "m/s", …)``, given those of the nuisance states by name."""
        derivatives = ("m", "m/s", "m/s²")[: self.order + 1]
        kinematic = tuple(unit for unit in derivatives for _ in range(self.dimension))
        return kinematic + tuple(nuisance_units[name] for name in self.nuisance)

    def convert(self, state: Array, source: StateLayout) -> Array:
        """``state`` of layout ``source`` in this layout; rows the source lacks are zero. The same array when equal."""
        if self == source:
            return state
        converted = zeros(state, (self.size, *state.shape[1:]))
        shared = min(self.kinematic.stop, source.kinematic.stop)
        converted[:shared] = state[:shared]
        for name in self.nuisance:
            if name in source.nuisance:
                converted[self.nuisance_row(name)] = state[source.nuisance_row(name)]
        return converted

    def shared_rows(self, other: StateLayout) -> list[tuple[int, int]]:
        """Pairs of rows that mean the same here and in another layout."""
        kinematic = min(self.kinematic.stop, other.kinematic.stop)
        common = [name for name in self.nuisance if name in other.nuisance]
        nuisances = [(self.nuisance_row(name), other.nuisance_row(name)) for name in common]
        return [(row, row) for row in range(kinematic)] + nuisances
