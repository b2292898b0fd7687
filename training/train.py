"""Training PPO on the native vector environment; ``passloc train`` and ``python -m training.train``."""

from __future__ import annotations

import dataclasses
import json
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

import numpy as np
import torch
from stable_baselines3.common.callbacks import CallbackList
from stable_baselines3.common.logger import configure
from stable_baselines3.common.vec_env import VecEnv, VecEnvWrapper

from agents.agent_file import AgentFile
from agents.shield import Shield
from agents.symmetry import MirrorSymmetry
from passloc_env.models import observation_names
from passloc_env.sb3 import make_vec_env
from passloc_env.scenario import Scenario
from passloc_env.scenarios import find
from training.arguments import check_seed, file_stem, new_folder, parse_overrides
from training.commands import Train
from training.curve import CurveCallback
from training.families import Together, families_of, shares
from training.files import json_text, note, write_whole
from training.hyperparameters import Hyperparameters
from training.privileged import PrivilegedPolicy, WithTruth, truth_names
from training.progress import console
from training.progress_callback import ProgressCallback
from training.provenance import provenance
from training.vector_ppo import VectorPPO
from training.wrappers import Choosing, Guarded, Mirrored, RisingPrice, ScaledReward


@dataclass
class Run:
    """A finished training run."""

    folder: Path
    agent: AgentFile
    seconds: float
    curve: list[dict[str, float]] = field(repr=False, default_factory=list)

    def to_dict(self) -> dict[str, Any]:
        """Where the agent is, how long it took, and its learning curve."""
        return {"folder": str(self.folder), "seconds": self.seconds, "curve": self.curve}


def train(arguments: Train) -> Run:
    """Train as the arguments say.

    Raises:
        ScenarioError: an unknown scenario or field, or an impossible value.
        HyperparameterError: unusable hyperparameters.
        InputError: a negative seed.
        FileExistsError: the run folder already holds a run.
    """
    scenario = find(arguments.scenario).override(parse_overrides(arguments.override))
    parameters = _parameters(arguments, scenario)
    check_seed(arguments.seed)
    check_training(scenario, parameters)
    folder = new_folder(arguments.out, file_stem(scenario.name, arguments.seed))
    return run(scenario, parameters, folder, arguments.seed)


def train_and_say(arguments: Train) -> Run:
    """Train as :func:`train` does, and say how long it took and where the agent is."""
    finished = train(arguments)
    said = f"trained in {finished.seconds:.0f} s; the agent is in {finished.folder}"
    console.print(said, highlight=False, soft_wrap=True)
    return finished


def check_training(scenario: Scenario, parameters: Hyperparameters) -> None:
    """Say whatever is wrong with the overrides before there is a folder.

    Raises:
        ScenarioError: an unknown field or an impossible value.
        InputError: a mirror where there is no symmetry, or families that one agent cannot fly.
    """
    for family in families_of(scenario, parameters):
        if parameters.mirror:
            MirrorSymmetry(family)


def run(
    scenario: Scenario,
    parameters: Hyperparameters,
    folder: Path,
    seed: int,
    quiet: bool = False,
    watch: Callable[[dict[str, float]], None] = lambda row: None,
) -> Run:
    """Train one agent into an existing, empty folder, on the scenario with the hyperparameters' overrides applied.

    Where the hyperparameters name families, it meets all of them in equal parts.

    Args:
        scenario: the problem.
        parameters: how to train.
        folder: where everything goes.
        seed: of everything random.
        quiet: no progress bar.
        watch: called with each row of the learning curve; what it raises ends the training.
    """
    torch.set_num_threads(1)
    trained = scenario.override(parameters.overrides)
    _write_configuration(folder, trained, parameters, seed)
    env = learning_env(scenario, parameters, seed)
    model = build_ppo(env, parameters, seed)
    model.set_logger(configure(str(folder / "tensorboard"), ["tensorboard"]))
    curve = CurveCallback(folder / "curve.csv", watch)
    progress = ProgressCallback(scenario.name, parameters.decisions, shown=not quiet)
    begun = time.perf_counter()
    interrupted: KeyboardInterrupt | None = None
    try:
        model.learn(parameters.decisions, callback=CallbackList([curve, progress]))
    except KeyboardInterrupt as error:
        # What has been learnt so far is an agent all the same, and its card says how many decisions it has seen.
        interrupted = error
    finally:
        progress.stop()
        env.close()
    seconds = time.perf_counter() - begun
    agent = _agent(model, trained, parameters, seed, seconds)
    agent.save(folder)
    note(folder, f"the agent after {model.num_timesteps:,} decisions")
    if interrupted is not None:
        raise interrupted
    return Run(folder, agent, seconds, curve.rows)


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


def _agent(model: VectorPPO, scenario: Scenario, parameters: Hyperparameters, seed: int, seconds: float) -> AgentFile:
    """The trained actor with its card."""
    policy = model.policy
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
            "seed": seed,
            "decisions": model.num_timesteps,
            "seconds": round(seconds, 1),
            "hyperparameters": dataclasses.asdict(parameters),
            **provenance(sys.argv),
        },
    }
    return AgentFile(weights, json.loads(json.dumps(card)))


def _parameters(arguments: Train, scenario: Scenario) -> Hyperparameters:
    if arguments.hyperparameters is not None:
        parameters = Hyperparameters.load(arguments.hyperparameters)
    else:
        parameters = Hyperparameters.for_scenario(scenario.name)
    if arguments.decisions is not None:
        parameters = dataclasses.replace(parameters, decisions=arguments.decisions)
    return parameters


def _write_configuration(folder: Path, scenario: Scenario, parameters: Hyperparameters, seed: int) -> None:
    configuration = {
        "scenario": scenario.to_dict(),
        "hyperparameters": dataclasses.asdict(parameters),
        "seed": seed,
        "provenance": provenance(sys.argv),
    }
    write_whole(folder / "config.json", json_text(configuration))


def main() -> None:
    """``python -m training.train``: the same as ``passloc train``."""
    from training.cli import main as command_line

    sys.exit(command_line(["train", *sys.argv[1:]]))


if __name__ == "__main__":
    main()
