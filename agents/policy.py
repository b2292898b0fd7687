"""What a policy is: batched, and blind to the truth."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol, runtime_checkable

import numpy as np

from passloc_env.arrays import Array
from passloc_env.belief import Belief


@runtime_checkable
class Policy(Protocol):
    """Decides for every environment of a batch at once."""

    @property
    def name(self) -> str:
        """How tables call it."""
        ...

    @property
    def overrides(self) -> Mapping[str, Any]:
        """Scenario fields that must be changed for it to be flown at all, e.g. a speed of zero."""
        ...

    def act(self, observation: np.ndarray, belief: Belief, rng: np.random.Generator) -> np.ndarray:
        """The actions ``(N, a)``, each within [-1, 1].

        Args:
            observation: what the environments returned, ``(N, f)``.
            belief: the tracker's belief, batch axis last.
            rng: the policy's own random numbers.
        """
        ...


@runtime_checkable
class TruthKnowing(Policy, Protocol):
    """A policy that is told what nobody can know, to show what knowing it would be worth; its name says so.

    No belief ever holds the truth. It is handed over beside the belief, by those who fly whole episodes, and only to
    policies that have this method.
    """

    def act_on_truth(
        self, truth: Array, observation: np.ndarray, belief: Belief, rng: np.random.Generator
    ) -> np.ndarray:
        """The actions ``(N, a)``, given the true state of the emitter ``(n, N)`` in the rows of the belief's mean."""
        ...
