"""Trained agents on disk: weights as safetensors, everything else as JSON beside them; nothing is ever unpickled."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from passloc_env.errors import InputError
from passloc_env.scenario import Scenario

WEIGHTS, CARD = "agent.safetensors", "agent.json"
_FORMAT = "passloc-agent-1"


class AgentFileError(InputError):
    """An agent file that cannot be used; the message is one line."""


@dataclass
class AgentFile:
    """What an agent is made of.

    Attributes:
        weights: arrays by name: ``actor.0.weight (out, in)``, ``actor.0.bias (out,)``, …
        card: architecture, spaces, scenario, training and scores.
    """

    weights: dict[str, np.ndarray]
    card: dict[str, Any]

    @property
    def scenario(self) -> Scenario:
        """The scenario it was trained on."""
        return Scenario.from_dict(self.card["scenario"])

    @property
    def flies(self) -> tuple[str, ...]:
        """The names of the scenarios that it is for; without a word in the card, the one it was trained on."""
        return tuple(self.card.get("flies", [self.scenario.name]))

    @property
    def actions(self) -> int:
        """Number of action components that the actor decides on."""
        return int(self.card["architecture"]["actor"][-1]) // max(int(self.card.get("choices", 0)), 1)

    @property
    def layers(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Weight ``(out, in)`` and bias ``(out,)`` of each layer of the actor."""
        count = len(self.card["architecture"]["actor"]) - 1
        return [(self.weights[f"actor.{i}.weight"], self.weights[f"actor.{i}.bias"]) for i in range(count)]

    def save(self, folder: Path) -> None:
        """Write both files into ``folder``; each appears whole or not at all."""
        from safetensors.numpy import save

        card = {"format": _FORMAT, **self.card}
        _write(folder / WEIGHTS, save(self.weights))
        _write(folder / CARD, (json.dumps(card, indent=2, allow_nan=False, ensure_ascii=False) + "\n").encode())

    @classmethod
    def load(cls, path: Path) -> AgentFile:
        """Read and check an agent.

        Args:
            path: a folder that holds ``agent.safetensors`` and ``agent.json``, or either file.

        Raises:
            AgentFileError: missing, unreadable or inconsistent files, weights that are not finite.
        """
        folder = path if path.is_dir() else path.parent
        if path.is_dir() and not (path / CARD).exists():
            raise AgentFileError(f"{path} is not a run folder: it holds no {CARD}")
        card = _read_card(folder / CARD)
        agent = cls(_read_weights(folder / WEIGHTS), card)
        agent._check(folder)
        return agent

    def _check(self, folder: Path) -> None:
        try:
            Scenario.from_dict(self.card["scenario"])
            _check_networks(self.card["architecture"], self.card["observation"])
            _check_flight(self.card.get("mirror", False), self.card.get("shield_sigmas", 0.0))
            _check_choices(self.card.get("choices", 0), self.card["architecture"]["actor"][-1])
            _check_names(self.card.get("flies", []))
        except (KeyError, TypeError, ValueError) as error:
            reason = f"{error} is missing" if isinstance(error, KeyError) else str(error)
            raise AgentFileError(f"{folder / CARD} does not describe an agent: {reason}") from None
        sizes = self.card["architecture"]["actor"]
        expected = {
            f"actor.{layer}.{kind}": (sizes[layer + 1], sizes[layer]) if kind == "weight" else (sizes[layer + 1],)
            for layer in range(len(sizes) - 1)
            for kind in ("weight", "bias")
        }
        found = {name: array.shape for name, array in self.weights.items()}
        if found != expected:
            raise AgentFileError(f"{folder / WEIGHTS} does not hold the actor that {CARD} describes")
        if not all(np.isfinite(array).all() for array in self.weights.values()):
            raise AgentFileError(f"{folder / WEIGHTS} holds weights that are not finite")


def _check_networks(architecture: Any, observation: Any) -> None:
    """ValueError unless there is an actor for the observation, and nothing else."""
    if not isinstance(observation, list) or not all(isinstance(name, str) for name in observation):
        raise ValueError("observation must be a list of names")
    if not isinstance(architecture, dict) or set(architecture) != {"actor"}:
        raise ValueError("architecture must hold an actor")
    sizes = architecture["actor"]
    whole = isinstance(sizes, list) and all(isinstance(size, int) and size > 0 for size in sizes)
    if not whole or len(sizes) < 2 or sizes[0] != len(observation):
        raise ValueError(f"actor must list its layer sizes, from the {len(observation)} features on")


def _check_flight(mirror: Any, sigmas: Any) -> None:
    """ValueError unless mirror and shield, where the card speaks of them, are ones."""
    if not isinstance(mirror, bool):
        raise ValueError("mirror must be true or false")
    number = isinstance(sigmas, (int, float)) and not isinstance(sigmas, bool)
    if not number or not 0.0 <= sigmas < math.inf:
        raise ValueError("shield_sigmas must be a finite number of at least 0")


def _check_choices(choices: Any, outputs: int) -> None:
    """ValueError unless these are numbers of choices, of which the actor rates each."""
    if not isinstance(choices, int) or isinstance(choices, bool) or choices < 0 or choices == 1:
        raise ValueError("choices must be 0 or a whole number of at least 2")
    if choices and outputs % choices:
        raise ValueError(f"the actor's {outputs} outputs must be a multiple of its {choices} choices")


def _check_names(flies: Any) -> None:
    """ValueError unless these are names of scenarios."""
    if not isinstance(flies, list) or not all(isinstance(name, str) for name in flies):
        raise ValueError("flies must be a list of names of scenarios")


def _read_card(path: Path) -> dict[str, Any]:
    try:
        card = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise AgentFileError(f"cannot read {path}: {error.strerror}") from None
    except (ValueError, RecursionError) as error:
        raise AgentFileError(f"{path} is not readable JSON: {error}") from None
    if not isinstance(card, dict) or card.get("format") != _FORMAT:
        raise AgentFileError(f"{path} is not the card of a passloc agent (format {_FORMAT})")
    return card


def _read_weights(path: Path) -> dict[str, np.ndarray]:
    from safetensors import SafetensorError
    from safetensors.numpy import load

    try:
        return load(path.read_bytes())
    except OSError as error:
        raise AgentFileError(f"cannot read {path}: {error.strerror}") from None
    except (SafetensorError, ValueError, KeyError) as error:
        raise AgentFileError(f"{path} is not a readable safetensors file: {error}") from None


def _write(path: Path, content: bytes) -> None:
    """Write a file so that a reader never sees half of it."""
    partial = path.with_name(path.name + ".partial")
    partial.write_bytes(content)
    partial.replace(path)
