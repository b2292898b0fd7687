"""Agents of Stable-Baselines3 made passloc's own: the actor's weights are read, and nothing in the file is run.

A model's archive holds weights beside pickles, which can do anything when they are opened. What is needed of them
stands beside them in plain words; they themselves are never touched.
"""

from __future__ import annotations

import hashlib
import sys
from pathlib import Path
from typing import Any

import numpy as np

from agents.agent_file import AgentFile
from passloc_env.belief import OBSERVATION_LIMIT
from passloc_env.errors import InputError, shown
from passloc_env.models import observation_names
from passloc_env.reading import json_data, read_bytes
from passloc_env.scenario import Scenario
from passloc_env.scenarios import find
from training.actor_weights import actor_layers
from training.archives import ARCHIVE_LIMIT, open_archive, read_member
from training.arguments import new_folder, parse_overrides
from training.commands import Convert
from training.files import note
from training.progress import console
from training.provenance import provenance

_SETTINGS, _WEIGHTS = "data", "policy.pth"
_MEMBERS = {
    _SETTINGS,
    _WEIGHTS,
    "policy.optimizer.pth",
    "pytorch_variables.pth",
    "_stable_baselines3_version",
    "system_info.txt",
}
"""What a model of PPO or A2C consists of."""

_PICKLE = b"\x80"
_STATISTICS = (
    "is a pickle, which could do anything when it is opened: statistics of VecNormalize are not read; fold them into "
    "the first layer before the model is saved, as the guide on files of strangers shows, or train without them"
)
_POLICIES = "stable_baselines3.common.policies"


def convert(arguments: Convert) -> Path:
    """Make an agent of a model; its folder.

    Raises:
        InputError: an unreadable model, one that is no plain actor with tanh layers, or that does not fit the scenario.
        ScenarioError: an unknown scenario or field, or an impossible value.
        FileExistsError: the folder already holds something.
    """
    scenario = find(arguments.scenario).override(parse_overrides(arguments.override))
    agent = converted(arguments.model, scenario)
    folder = new_folder(arguments.out, f"{scenario.name}-converted")
    agent.save(folder)
    note(folder)
    console.print(f"the agent is in {folder}", highlight=False, soft_wrap=True)
    return folder


def converted(path: Path, scenario: Scenario) -> AgentFile:
    """The agent that decides as ``predict(deterministic=True)`` of a model does.

    Args:
        path: what ``model.save`` of PPO or A2C has written.
        scenario: what the model was trained on, on whose spaces it must act.

    Raises:
        InputError: as :func:`convert`.
    """
    try:
        content = read_bytes(path, ARCHIVE_LIMIT)
        settings, weights = _settings_and_weights(content)
        _check_policy(settings)
        _check_spaces(settings)
        layers = actor_layers(weights)
        _check_fit(layers, scenario)
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}") from None
    except InputError as error:
        raise InputError(f"{path} {error}") from None
    training = {
        "algorithm": "converted from Stable-Baselines3",
        "model_sha256": hashlib.sha256(content).hexdigest(),
        **provenance(sys.argv),
    }
    card = {
        "architecture": {"actor": [layers[0][0].shape[1], *(len(bias) for _, bias in layers)]},
        "observation": list(observation_names(scenario)),
        "scenario": scenario.to_dict(),
        "training": training,
    }
    arrays: dict[str, np.ndarray] = {}
    for index, (weight, bias) in enumerate(layers):
        arrays |= {f"actor.{index}.weight": weight, f"actor.{index}.bias": bias}
    return AgentFile(arrays, card)


def _settings_and_weights(content: bytes) -> tuple[dict[str, Any], bytes]:
    """The settings of a model and the file of its weights."""
    if content.startswith(_PICKLE):
        raise InputError(_STATISTICS)
    try:
        archive = open_archive(content)
        strangers = sorted(set(archive.namelist()) - _MEMBERS)
        if strangers:
            raise InputError(f"an archive with {shown(strangers[0])}")
        text, weights = (read_member(archive, name) for name in (_SETTINGS, _WEIGHTS))
    except InputError as error:
        raise InputError(f"is no model of PPO or A2C: {error}") from None
    try:
        settings = json_data(text.decode())
    except ValueError:
        settings = None
    if not isinstance(settings, dict):
        raise InputError(f"is no model of PPO or A2C: its {_SETTINGS} is not readable JSON")
    return settings, weights


def _check_policy(settings: dict[str, Any]) -> None:
    """InputError unless the policy is of the library's own kind, its layers joined by tanh and nothing behind them."""
    home, words = _words(settings.get("policy_class")).get("__module__"), _words(settings.get("policy_kwargs"))
    if home != _POLICIES:
        raise InputError(f"has a policy of {shown(home)}: only PPO's and A2C's own can be converted")
    if not str(words.get("activation_fn", "Tanh'>")).endswith("Tanh'>"):
        raise InputError(f"joins its layers by {shown(words['activation_fn'])}: agents of passloc are joined by tanh")
    for name in ("squash_output", "features_extractor_class"):
        if words.get(name):
            raise InputError(f"was made with {name} = {shown(words[name])}, which agents of passloc do not know")


def _check_spaces(settings: dict[str, Any]) -> None:
    """InputError unless the model saw and acted within the limits of our spaces."""
    for name, limit in (("observation_space", OBSERVATION_LIMIT), ("action_space", 1.0)):
        space = _words(settings.get(name))
        for end, expected in (("low", -limit), ("high", limit)):
            numbers = str(space.get(end, "")).strip("[]").split()
            if not numbers or not all(number in (f"{expected:g}.", f"{expected:g}.0") for number in numbers):
                raise InputError(f"has another {name} than passloc: its {end} is {shown(space.get(end))}")


def _check_fit(layers: list[tuple[np.ndarray, np.ndarray]], scenario: Scenario) -> None:
    """InputError unless the actor sees and decides as much as the scenario offers and takes."""
    sees, acts = layers[0][0].shape[1], len(layers[-1][1])
    features, actions = len(observation_names(scenario)), scenario.action_size
    if (sees, acts) != (features, actions):
        raise InputError(
            f"sees {sees} features and decides {acts} actions; {scenario.name} offers {features} and takes {actions}"
        )


def _words(setting: Any) -> dict[str, Any]:
    """What stands in plain words beside the pickle of a setting."""
    return setting if isinstance(setting, dict) else {}
