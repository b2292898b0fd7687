"""The infos of a step as Stable-Baselines3 wants them: a list of dictionaries, of which few say anything."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any


class Infos(list[Any]):
    """A dictionary for each environment, made when it is first looked at.

    Args:
        environments: how many.
        told: those that say something, by environment.
    """

    def __init__(self, environments: int, told: Mapping[int, dict[str, Any]]) -> None:
        super().__init__([None] * environments)
        for index, info in told.items():
            self[index] = info

    def __getitem__(self, index: Any) -> Any:
        """One, or a list of some."""
        if isinstance(index, slice):
            return [self[each] for each in range(*index.indices(len(self)))]
        info = super().__getitem__(index)
        if info is None:
            self[index] = info = {}
        return info

    def __iter__(self) -> Iterator[dict[str, Any]]:
        """All, one after the other."""
        return (self[index] for index in range(len(self)))

    def __eq__(self, other: object) -> bool:
        """Whether a list says the same."""
        return self.copy() == (other.copy() if isinstance(other, Infos) else other)

    __hash__ = None

    def __repr__(self) -> str:
        return repr(self.copy())

    def copy(self) -> list[Any]:
        """A plain list of the same dictionaries."""
        return list(self)

    def __reduce__(self) -> tuple[Any, ...]:
        """Copied and pickled as the plain list that it stands for."""
        return list, (self.copy(),)
