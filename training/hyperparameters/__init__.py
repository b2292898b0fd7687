"""passloc training: how agents are trained, scenario by scenario, in YAML files beside this module."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from passloc_env.errors import InputError

_FOLDER = Path(__file__).parent


class HyperparameterError(InputError):
    """Hyperparameters that cannot be used; the message is one line."""


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
    """Logarithm of the initial standard deviation of the action."""
    reward_scale: float = 0.02
    """The learner sees the reward times this, so that returns are of the order of one."""
    network: tuple[int, ...] = (64, 64)
    """Hidden layers of actor and critic."""
    overrides: dict[str, Any] = field(default_factory=dict)
    """Scenario fields changed for training alone, by dotted name."""

    def __post_init__(self) -> None:
        positive = ("decisions", "environments", "rollout", "batch_size", "epochs", "learning_rate", "reward_scale")
        for name in positive:
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, (int, float)) or not value > 0:
                raise HyperparameterError(f"{name} = {value!r} is not possible: must be a number above 0")
        for name in ("discount", "trace_decay"):
            if not 0.0 < getattr(self, name) <= 1.0:
                raise HyperparameterError(f"{name} = {getattr(self, name)!r} is not possible: must be in (0, 1]")

    @classmethod
    def load(cls, path: Path) -> Hyperparameters:
        """Read a YAML file; HyperparameterError when it is unreadable or names what does not exist."""
        try:
            data = yaml.safe_load(path.read_text(encoding="utf-8")) or {}
        except OSError as error:
            raise HyperparameterError(f"cannot read {path}: {error.strerror}") from None
        except yaml.YAMLError as error:
            raise HyperparameterError(f"{path} is not readable YAML: {' '.join(str(error).split())}") from None
        known = [item.name for item in dataclasses.fields(cls)]
        if not isinstance(data, dict) or not set(data) <= set(known):
            unknown = sorted(set(data) - set(known)) if isinstance(data, dict) else data
            raise HyperparameterError(f"{path}: unknown hyperparameters {unknown}; known: {', '.join(known)}")
        if "network" in data:
            data["network"] = tuple(data["network"])
        return cls(**data)

    @classmethod
    def for_scenario(cls, name: str) -> Hyperparameters:
        """The tuned file of a named scenario, or the defaults where there is none."""
        path = _FOLDER / f"{name}.yaml"
        return cls.load(path) if path.exists() else cls()
