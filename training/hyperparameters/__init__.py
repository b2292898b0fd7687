"""passloc training: how agents are trained, scenario by scenario, in YAML files beside this module.

A file is for the scenario whose name it bears, and for those of the catalogue whose names begin so and that have no
file of their own.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from passloc_env.errors import InputError, shown
from passloc_env.reading import read_text, yaml_data
from passloc_env.scenarios import SCENARIOS

_FOLDER = Path(__file__).parent


class HyperparameterError(InputError):
    """Hyperparameters that cannot be used; the message is one line."""


def _whole(value: Any, least: int = 1) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value >= least


def _finite(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


_WHOLE = ("a whole number of at least 1", _whole)
_POSITIVE = ("a finite number above 0", lambda value: _finite(value) and value > 0)
_SHARE = ("above 0 and at most 1", lambda value: _finite(value) and 0 < value <= 1)

_ACCEPTS: dict[str, tuple[str, Callable[[Any], bool]]] = {
    "decisions": _WHOLE,
    "environments": _WHOLE,
    "rollout": _WHOLE,
    "batch_size": ("a whole number of at least 2", lambda value: _whole(value, least=2)),
    "epochs": _WHOLE,
    "learning_rate": _POSITIVE,
    "discount": _SHARE,
    "trace_decay": _SHARE,
    "entropy": ("a finite number of at least 0", lambda value: _finite(value) and value >= 0),
    "initial_log_sigma": ("a finite number", _finite),
    "reward_scale": _POSITIVE,
    "violation_price": ("a finite number of at least 0", lambda value: _finite(value) and value >= 0),
    "network": ("a list of layer widths", lambda value: isinstance(value, tuple) and all(map(_whole, value))),
    "choices": ("0 or a whole number of at least 2", lambda value: _whole(value, least=0) and value != 1),
    "mirror": ("true or false", lambda value: isinstance(value, bool)),
    "shield_sigmas": ("a finite number of at least 0", lambda value: _finite(value) and value >= 0),
    "shielded_training": ("true or false", lambda value: isinstance(value, bool)),
    "privileged_critic": ("true or false", lambda value: isinstance(value, bool)),
    "overrides": ("a mapping from dotted names to values", lambda value: isinstance(value, dict)),
    "families": (
        "a list of mappings from dotted names to values",
        lambda value: isinstance(value, tuple) and all(isinstance(item, dict) for item in value),
    ),
}
"""What each hyperparameter accepts, in words and as a test."""


@dataclass(frozen=True)
class Hyperparameters:
    """How PPO is trained."""

    decisions: int = 2_000_000
    """Decisions of all environments together."""
    environments: int = 256
    """Environments stepped together."""
    rollout: int = 60
    """Decisions of each environment between two updates; one episode learns best."""
    batch_size: int = 1024
    """Decisions per gradient step."""
    epochs: int = 8
    """Passes over each rollout."""
    learning_rate: float = 1e-3
    """At the start; falls linearly to zero."""
    discount: float = 0.99
    """Discount per decision."""
    trace_decay: float = 0.95
    """Lambda of the generalised advantage estimate."""
    entropy: float = 0.0
    """Weight of the entropy bonus."""
    initial_log_sigma: float = -1.0
    """Logarithm of the initial standard deviation of a Gaussian action."""
    reward_scale: float = 0.02
    """The learner sees the reward times this, so that returns are of the order of one."""
    violation_price: float = 0.0
    """What an episode that ends in a violation costs at the end of training, in reward; it rises from nothing."""
    network: tuple[int, ...] = (64, 64)
    """Hidden layers of actor and critic."""
    choices: int = 0
    """Values of each action component, evenly spread, that the agent chooses from; 0 for a Gaussian action."""
    mirror: bool = False
    """Whether the agent learns one side of the line of sight only, and flies the other by symmetry."""
    shield_sigmas: float = 0.0
    """Deviations by which a shield keeps the minimum range in flight; 0 for no shield."""
    shielded_training: bool = False
    """Whether the shield is there in training already; it costs as much time as the rest of the training."""
    privileged_critic: bool = False
    """Whether the critic is told the truth; the actor never is."""
    overrides: dict[str, Any] = field(default_factory=dict)
    """Scenario fields changed for training alone, by dotted name."""
    families: tuple[dict[str, Any], ...] = ()
    """Further changes, one mapping per family: the environments are shared out evenly among them."""

    def __post_init__(self) -> None:
        for name, (allowed, accepts) in _ACCEPTS.items():
            if not accepts(getattr(self, name)):
                raise HyperparameterError(f"{name} = {shown(getattr(self, name))} is not possible: must be {allowed}")

    @property
    def ppo_keywords(self) -> dict[str, Any]:
        """What Stable-Baselines3's PPO takes as it stands, by its own names."""
        return {
            "n_steps": self.rollout,
            "batch_size": self.batch_size,
            "n_epochs": self.epochs,
            "gamma": self.discount,
            "gae_lambda": self.trace_decay,
            "ent_coef": self.entropy,
        }

    @classmethod
    def load(cls, path: Path) -> Hyperparameters:
        """Read a YAML file; HyperparameterError when it is unreadable or names what does not exist."""
        try:
            data = yaml_data(read_text(path)) or {}
        except OSError as error:
            raise HyperparameterError(f"cannot read {path}: {error.strerror}") from None
        except InputError as error:
            raise HyperparameterError(f"{path} is not readable YAML: {error}") from None
        try:
            return cls.from_dict(data)
        except HyperparameterError as error:
            raise HyperparameterError(f"{path}: {error}") from None

    @classmethod
    def from_dict(cls, data: Any) -> Hyperparameters:
        """From plain data; HyperparameterError when it names what does not exist, or says something impossible."""
        known = [item.name for item in dataclasses.fields(cls)]
        if not isinstance(data, dict) or not set(data) <= set(known):
            unknown = sorted(map(str, set(data) - set(known))) if isinstance(data, dict) else data
            raise HyperparameterError(f"unknown hyperparameters {shown(unknown)}; known: {', '.join(known)}")
        lists = {name: tuple(data[name]) for name in ("network", "families") if isinstance(data.get(name), list)}
        return cls(**data | lists)

    @classmethod
    def for_scenario(cls, name: str) -> Hyperparameters:
        """Those of a named scenario: of the file with the longest name that its name begins with, or the defaults.

        A scenario that is not of the catalogue needs a file of just its name: it may be a stranger to its namesakes.
        """
        files = [
            path
            for path in _FOLDER.glob("*.yaml")
            if path.stem == name or (name in SCENARIOS and name.startswith(path.stem))
        ]
        return cls.load(max(files, key=lambda path: len(path.stem))) if files else cls()
