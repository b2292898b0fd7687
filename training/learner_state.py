"""All that decides how a training goes on: networks, optimiser, generators, environments; and putting it back."""

from __future__ import annotations

import random
from collections.abc import Mapping
from typing import Any, cast

import numpy as np
import torch
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper

from training.families import Together
from training.likeness import check_like
from training.vector_ppo import VectorPPO

_COUNTERS = ("num_timesteps", "_n_updates")


def has_learnt(model: VectorPPO) -> bool:
    """Whether the policy is another one than at the beginning."""
    return model._n_updates > 0


def learner_state(model: VectorPPO, env: VecEnv) -> dict[str, Any]:
    """The state of a learner between two rollouts, as a tree of arrays and plain data.

    Args:
        model: has collected and learnt, and is about to collect again.
        env: what it learns from, with all its wrappers.
    """
    optimiser = model.policy.optimizer.state_dict()
    return {
        "policy": _arrays(model.policy.state_dict()),
        "optimiser": {
            "moments": {str(index): _arrays(moments) for index, moments in optimiser["state"].items()},
            "groups": optimiser["param_groups"],
        },
        "counters": {name: getattr(model, name) for name in _COUNTERS},
        "observation": np.asarray(model._last_obs),
        "starts": np.asarray(model._last_episode_starts),
        "generators": _generators(),
        "env": _env_state(env),
    }


def put_back(state: Mapping[str, Any], model: VectorPPO, env: VecEnv) -> None:
    """Go on from a state of :func:`learner_state` with a new learner of the same build.

    Raises:
        KeyError, ValueError, RuntimeError: the state is of another build.
    """
    model.policy.load_state_dict(_tensors(state["policy"]))
    moments = {int(index): _tensors(kept) for index, kept in state["optimiser"]["moments"].items()}
    model.policy.optimizer.load_state_dict({"state": moments, "param_groups": state["optimiser"]["groups"]})
    for name in _COUNTERS:
        setattr(model, name, state["counters"][name])
    model._last_obs = state["observation"].copy()
    model._last_episode_starts = state["starts"].copy()
    _set_env_state(env, state["env"])
    _set_generators(state["generators"])


def check_state(state: Any, model: VectorPPO, env: VecEnv) -> None:
    """Whether a state can be put back into a new learner, looked at before anything of it is.

    The learner is left between resets: a state must be put back before it learns.

    Raises:
        ValueError: the state is of another build, or holds what no learner of this build can have come to.
    """
    model._last_obs = cast(np.ndarray, env.reset())
    model._last_episode_starts = np.ones(env.num_envs, bool)
    like = learner_state(model, env)
    # Moments are there from the first update on, one for each parameter that has learnt.
    parameters = model.policy.optimizer.param_groups[0]["params"]
    moments = {str(index): _moments(parameter) for index, parameter in enumerate(parameters)}
    try:
        found = state["optimiser"]["moments"]
        like["optimiser"]["moments"] = {name: moments[name] for name in found}
    except (KeyError, TypeError, IndexError):
        raise ValueError("it holds no optimiser of this learner") from None
    check_like(state, like, "learner")
    if not all(np.isfinite(weights).all() for weights in state["policy"].values()):
        raise ValueError("learner.policy is not finite")
    # NumPy itself would read wherever that points.
    if state["generators"]["numpy"]["position"] > len(state["generators"]["numpy"]["keys"]):
        raise ValueError("learner.generators.numpy.position is not possible")


def _moments(parameter: torch.Tensor) -> dict[str, np.ndarray]:
    """The shapes of what Adam remembers of a parameter."""
    shape = np.zeros(tuple(parameter.shape), np.float32)
    return {"step": np.zeros((), np.float32), "exp_avg": shape, "exp_avg_sq": shape}


def _arrays(tensors: Mapping[str, torch.Tensor]) -> dict[str, np.ndarray]:
    return {name: tensor.detach().cpu().numpy().copy() for name, tensor in tensors.items()}


def _tensors(arrays: Mapping[str, np.ndarray]) -> dict[str, torch.Tensor]:
    return {name: torch.from_numpy(array.copy()) for name, array in arrays.items()}


def _generators() -> dict[str, Any]:
    """Those that Stable-Baselines3 seeds and uses: of PyTorch, NumPy and Python."""
    _, keys, position, has_gauss, cached = np.random.get_state(legacy=True)  # noqa: NPY002 - it is SB3's
    return {
        "torch": torch.get_rng_state().numpy().copy(),
        "numpy": {"keys": np.asarray(keys), "position": position, "has_gauss": has_gauss, "cached": cached},
        "python": random.getstate(),
    }


def _set_generators(state: Mapping[str, Any]) -> None:
    torch.set_rng_state(torch.from_numpy(state["torch"].copy()))
    words = state["numpy"]
    kept = ("MT19937", words["keys"], words["position"], words["has_gauss"], words["cached"])
    np.random.set_state(kept)  # noqa: NPY002
    version, internal, gauss = state["python"]
    random.setstate((version, tuple(internal), gauss))


def _env_state(env: VecEnv) -> dict[str, Any]:
    """Of a chain of wrappers, outermost first; wrappers without a memory have no state."""
    if isinstance(env, Together):
        return {"worlds": [_env_state(world) for world in env.worlds]}
    # A wrapper passes on what it is asked for and does not have: only its class says what is its own.
    stateful: Any = env
    state = {"own": stateful.get_state()} if hasattr(type(env), "get_state") else {}
    return state | {"inner": _env_state(env.venv)} if isinstance(env, VecEnvWrapper) else state


def _set_env_state(env: VecEnv, state: Mapping[str, Any]) -> None:
    if isinstance(env, Together):
        for world, own in zip(env.worlds, state["worlds"], strict=True):
            _set_env_state(world, own)
        return
    stateful: Any = env
    if hasattr(type(env), "set_state"):
        stateful.set_state(state["own"])
    if isinstance(env, VecEnvWrapper):
        _set_env_state(env.venv, state["inner"])
