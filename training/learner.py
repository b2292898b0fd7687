"""A learner for a scenario: the environments as it meets them, PPO, and the agent that comes of it."""

from __future__ import annotations

import dataclasses
import json
from typing import Any, cast

import numpy as np
import torch
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper

from agents.agent_file import AgentFile
from agents.shield import Shield
from agents.symmetry import MirrorSymmetry
from passloc_env.models import observation_names
from passloc_env.sb3 import make_vec_env
from passloc_env.scenario import Scenario
from training.families import Together, families_of, shares
from training.hyperparameters import Hyperparameters
from training.privileged import PrivilegedPolicy, WithTruth, truth_names
from training.run_folder import Assignment
from training.vector_ppo import VectorPPO
from training.wrappers import Choosing, Guarded, Mirrored, RisingPrice, ScaledReward


def learning_env(scenario: Scenario, parameters: Hyperparameters, seed: int) -> VecEnv:
    """The environments as the learner meets them: shield, price, mirror, choices, scaled rewards."""
    families = families_of(scenario, parameters)
    counts = shares(parameters.environments, len(families))
    worlds = [_world(family, parameters, count) for family, count in zip(families, counts, strict=True)]
    env = worlds[0] if len(worlds) == 1 else Together(worlds)
    env.seed(seed)
    if parameters.violation_price:
        env = RisingPrice(env, parameters.violation_price, parameters.decisions)
    if parameters.mirror:
        further = truth_names(families[0]) if parameters.privileged_critic else ()
        env = Mirrored(env, MirrorSymmetry(families[0], further))
    if parameters.choices:
        env = Choosing(env, parameters.choices)
    return ScaledReward(env, parameters.reward_scale)


def _world(family: Scenario, parameters: Hyperparameters, environments: int) -> VecEnv:
    """Environments of one family, behind the shield, its truth told."""
    world: VecEnv = make_vec_env(family, environments, bootstrap_time_limit=False)
    if parameters.shielded_training:
        world = Guarded(world, Shield(parameters.shield_sigmas))
    return WithTruth(world) if parameters.privileged_critic else world


def build_ppo(env: VecEnv, parameters: Hyperparameters, seed: int) -> VectorPPO:
    """PPO with separate actor and critic, tanh layers and a linearly falling learning rate."""
    policy: dict[str, Any] = {
        "net_arch": list(parameters.network),
        "log_std_init": parameters.initial_log_sigma,
    }
    if parameters.privileged_critic:
        policy["seen"] = cast(VecEnvWrapper, env).getattr_recursive("seen")
    return VectorPPO(
        PrivilegedPolicy if parameters.privileged_critic else "MlpPolicy",
        env,
        learning_rate=lambda remaining: parameters.learning_rate * max(remaining, 0.0),
        **parameters.ppo_keywords,
        policy_kwargs=policy,
        seed=seed,
        device="cpu",
    )


def agent_of(model: VectorPPO, assignment: Assignment, seconds: float) -> AgentFile:
    """The trained actor with its card."""
    policy, scenario, parameters = model.policy, assignment.scenario, assignment.parameters
    modules = [*policy.mlp_extractor.policy_net, policy.action_net]
    layers = [module for module in modules if isinstance(module, torch.nn.Linear)]
    weights: dict[str, np.ndarray] = {}
    for index, layer in enumerate(layers):
        weights[f"actor.{index}.weight"] = layer.weight.detach().numpy().copy()
        weights[f"actor.{index}.bias"] = layer.bias.detach().numpy().copy()
    card = {
        "architecture": {"actor": [layers[0].in_features, *(int(layer.out_features) for layer in layers)]},
        "observation": list(observation_names(scenario)),
        "scenario": scenario.to_dict(),
        "choices": parameters.choices,
        "mirror": parameters.mirror,
        "shield_sigmas": parameters.shield_sigmas,
        "training": {
            "algorithm": "PPO",
            "seed": assignment.seed,
            "decisions": model.num_timesteps,
            "seconds": round(seconds, 1),
            "hyperparameters": dataclasses.asdict(parameters),
            **assignment.origin,
        },
    }
    return AgentFile(weights, json.loads(json.dumps(card)))
