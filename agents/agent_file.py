"""Trained agents on disk: weights as safetensors, everything else as JSON beside them; nothing is ever unpickled."""

from __future__ import annotations

import hashlib
import itertools
import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from passloc_env.errors import InputError, one_line
from passloc_env.models import observation_names
from passloc_env.reading import json_data, read_bytes, read_text
from passloc_env.scenario import Scenario

WEIGHTS, CARD = "agent.safetensors", "agent.json"
_FORMAT = "passloc-agent-1"
_DIGEST = "weights_sha256"
"""What the card calls the SHA-256 of the weights file, in hexadecimal digits."""

WEIGHTS_LIMIT = 1 << 26
"""Bytes that the weights of an agent may take: sixteen million numbers."""

SIZES_LIMIT = 100
"""Layer sizes that an actor may have."""

_HEADER_LIMIT = 1 << 16
"""Bytes that the list of arrays at the beginning of a weights file may take."""


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
        """Write both files into ``folder``; each appears whole or not at all, and the card vouches for the weights."""
        from safetensors.numpy import save

        weights = save(self.weights)
        card = {"format": _FORMAT, **self.card, _DIGEST: hashlib.sha256(weights).hexdigest()}
        _write(folder / WEIGHTS, weights)
        _write(folder / CARD, (json.dumps(card, indent=2, allow_nan=False, ensure_ascii=False) + "\n").encode())

    @classmethod
    def load(cls, path: Path) -> AgentFile:
        """Read and check an agent.

        Args:
            path: a folder that holds ``agent.safetensors`` and ``agent.json``, or either file.

        Raises:
            AgentFileError: missing, unreadable or inconsistent files, weights that are not finite or not those that the
                card was written for.
        """
        folder = path if path.is_dir() else path.parent
        if path.is_dir() and not (path / CARD).exists():
            raise AgentFileError(f"{path} is not a run folder: it holds no {CARD}")
        card = _read_card(folder / CARD)
        return cls(_read_weights(folder / WEIGHTS, card), card)


def _read_card(path: Path) -> dict[str, Any]:
    try:
        card = json_data(read_text(path))
    except OSError as error:
        raise AgentFileError(f"cannot read {path}: {error.strerror}") from None
    except InputError as error:
        raise AgentFileError(f"{path} is not readable JSON: {error}") from None
    if not isinstance(card, dict) or card.get("format") != _FORMAT:
        raise AgentFileError(f"{path} is not the card of a passloc agent (format {_FORMAT})")
    try:
        scenario = Scenario.from_dict(card["scenario"])
        _check_networks(card["architecture"], card["observation"])
        if card["observation"] != list(observation_names(scenario)):
            raise ValueError(f"observation is not what {scenario.name} offers")
        _check_flight(card.get("mirror", False), card.get("shield_sigmas", 0.0))
        _check_choices(card.get("choices", 0), card["architecture"]["actor"][-1])
        _check_names(card.get("flies", []))
        _check_training(card.get("training", {}))
    except (KeyError, ValueError) as error:
        reason = f"{error} is missing" if isinstance(error, KeyError) else str(error)
        raise AgentFileError(f"{path} does not describe an agent: {reason}") from None
    return card


def _read_weights(path: Path, card: dict[str, Any]) -> dict[str, np.ndarray]:
    """The weights that a card speaks of."""
    from safetensors import SafetensorError
    from safetensors.numpy import load

    try:
        content = read_bytes(path, WEIGHTS_LIMIT)
        _check_digest(content, card.get(_DIGEST))
        if int.from_bytes(content[:8], "little") > _HEADER_LIMIT:
            raise ValueError("its header is too large for that of an agent")
        weights = load(content)
    except OSError as error:
        raise AgentFileError(f"cannot read {path}: {error.strerror}") from None
    except InputError as error:
        raise AgentFileError(f"{path} {error}") from None
    except (SafetensorError, ValueError, KeyError) as error:
        raise AgentFileError(f"{path} is not a readable safetensors file: {one_line(error)}") from None
    if {name: (array.dtype, array.shape) for name, array in weights.items()} != _actor(card["architecture"]["actor"]):
        raise AgentFileError(f"{path} does not hold the actor that {CARD} describes")
    if not all(np.isfinite(array).all() for array in weights.values()):
        raise AgentFileError(f"{path} holds weights that are not finite")
    return weights


def _check_digest(content: bytes, wanted: Any) -> None:
    """InputError unless these are the weights that the card was written for; cards of old do not say."""
    found = hashlib.sha256(content).hexdigest()
    if wanted not in (None, found):
        raise InputError(f"was changed: its SHA-256 is {found}, not what {CARD} says")


def _actor(sizes: list[int]) -> dict[str, tuple[np.dtype[Any], tuple[int, ...]]]:
    """Type and shape of each array of an actor, by name."""
    number, layers = np.dtype(np.float32), list(itertools.pairwise(sizes))
    weights = {f"actor.{i}.weight": (number, (out, fed)) for i, (fed, out) in enumerate(layers)}
    return weights | {f"actor.{i}.bias": (number, (out,)) for i, (_, out) in enumerate(layers)}


def _check_networks(architecture: Any, observation: Any) -> None:
    """ValueError unless there is an actor for the observation, and nothing else."""
    if not isinstance(observation, list) or not all(isinstance(name, str) for name in observation):
        raise ValueError("observation must be a list of names")
    if not isinstance(architecture, dict) or set(architecture) != {"actor"}:
        raise ValueError("architecture must hold an actor")
    sizes = architecture["actor"]
    whole = isinstance(sizes, list) and all(type(size) is int and size > 0 for size in sizes)
    if not whole or not 2 <= len(sizes) <= SIZES_LIMIT or sizes[0] != len(observation):
        raise ValueError(f"actor must list its 2 to {SIZES_LIMIT} layer sizes, from the {len(observation)} features on")


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
    if not isinstance(flies, list) or not all(isinstance(name, str) and name.isprintable() for name in flies):
        raise ValueError("flies must be a list of names of scenarios")


def _check_training(training: Any) -> None:
    """ValueError unless this can be what is said of a training."""
    if not isinstance(training, dict) or not isinstance(training.get("command", ""), str):
        raise ValueError("training must be a mapping, its command a text")


def _write(path: Path, content: bytes) -> None:
    """Write a file so that a reader never sees half of it."""
    partial = path.with_name(path.name + ".partial")
    partial.write_bytes(content)
    partial.replace(path)
