"""Trained agents on disk: weights as safetensors, everything else as JSON beside them; nothing is ever unpickled."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from passloc_env.errors import InputError, ScenarioError
from passloc_env.scenario import Scenario

WEIGHTS, CARD = "agent.safetensors", "agent.json"
_FORMAT = "passloc-agent-1"


class AgentFileError(InputError):
    """An agent file that cannot be used; the message is one line."""


@dataclass
class AgentFile:
    """What an agent is made of.

    Attributes:
        weights: arrays by name: ``actor.0.weight (out, in)``, ``actor.0.bias (out,)``, …, the same for ``critic``.
        card: architecture, spaces, scenario, training and scores.
    """

    weights: dict[str, np.ndarray]
    card: dict[str, Any]

    @property
    def scenario(self) -> Scenario:
        """The scenario it was trained on."""
        return Scenario.from_dict(self.card["scenario"])

    def layers(self, network: str) -> list[tuple[np.ndarray, np.ndarray]]:
        """Weight ``(out, in)`` and bias ``(out,)`` of each layer of ``actor`` or ``critic``."""
        count = len(self.card["architecture"][network]) - 1
        return [(self.weights[f"{network}.{i}.weight"], self.weights[f"{network}.{i}.bias"]) for i in range(count)]

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
        card = _read_card(folder / CARD)
        agent = cls(_read_weights(folder / WEIGHTS), card)
        agent._check(folder)
        return agent

    def _check(self, folder: Path) -> None:
        try:
            self.scenario  # noqa: B018 — building it is the check
            expected = {
                f"{network}.{layer}.{kind}": (sizes[layer + 1], sizes[layer])
                if kind == "weight"
                else (sizes[layer + 1],)
                for network, sizes in self.card["architecture"].items()
                for layer in range(len(sizes) - 1)
                for kind in ("weight", "bias")
            }
        except (KeyError, TypeError, AttributeError, ScenarioError) as error:
            raise AgentFileError(f"{folder / CARD} does not describe an agent: {error}") from None
        found = {name: array.shape for name, array in self.weights.items()}
        if found != expected:
            raise AgentFileError(f"{folder / WEIGHTS} does not hold the networks that {CARD} describes")
        if not all(np.isfinite(array).all() for array in self.weights.values()):
            raise AgentFileError(f"{folder / WEIGHTS} holds weights that are not finite")


def _read_card(path: Path) -> dict[str, Any]:
    try:
        card = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise AgentFileError(f"cannot read {path}: {error.strerror}") from None
    except ValueError as error:
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
