"""Training PPO on the native vector environment; ``passloc train`` and ``python -m training.train``."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch
from stable_baselines3.common.callbacks import CallbackList
from stable_baselines3.common.vec_env import VecEnv

from agents.agent_file import CARD, AgentFile
from agents.symmetry import MirrorSymmetry
from passloc_env.errors import InputError, one_line
from passloc_env.scenario import Scenario
from passloc_env.scenarios import find
from training.arguments import check_seed, file_stem, new_folder, parse_overrides, writable_folder
from training.checkpoint import Checkpoint, CheckpointError, find_checkpoint, forget_checkpoints, has_checkpoint
from training.checkpoint_callback import CheckpointCallback
from training.commands import Train
from training.curve import CurveCallback
from training.event_log import event_log
from training.families import families_of
from training.files import note
from training.hyperparameters import Hyperparameters
from training.learner import agent_of, build_ppo, learning_env
from training.learner_state import learner_state, put_back
from training.lock import held
from training.progress import console
from training.progress_callback import ProgressCallback
from training.provenance import provenance
from training.run_folder import CURVE, Assignment
from training.vector_ppo import VectorPPO

Watch = Callable[[dict[str, float]], None]
"""Sees each row of a learning curve."""


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
        InputError: a negative seed, or a run that cannot be gone on with.
        FileExistsError: the run folder already holds a run.
    """
    if arguments.checkpoint < 0:
        raise InputError(f"checkpoint = {arguments.checkpoint} is not possible: must be at least 0")
    if arguments.resume is not None:
        return resume(_alone(arguments), arguments.checkpoint)
    scenario = find(arguments.scenario).override(parse_overrides(arguments.override))
    parameters = _parameters(arguments, scenario)
    check_seed(arguments.seed)
    check_training(scenario, parameters)
    folder = new_folder(arguments.out, file_stem(scenario.name, arguments.seed))
    return run(scenario, parameters, folder, arguments.seed, checkpoint=arguments.checkpoint)


def _alone(arguments: Train) -> Path:
    """The folder of a run to go on with; InputError when something is asked for that the run knows itself."""
    assert arguments.resume is not None
    asked = Train(resume=arguments.resume, checkpoint=arguments.checkpoint, output=arguments.output)
    for each in dataclasses.fields(Train):
        if getattr(arguments, each.name) != getattr(asked, each.name):
            raise InputError(f"{each.name} is not possible with resume: {arguments.resume} knows its own")
    return arguments.resume


def train_and_say(arguments: Train) -> Run:
    """Train as :func:`train` does, and say how long it took and where the agent is."""
    trained = train(arguments)
    said = f"trained in {trained.seconds:.0f} s; the agent is in {trained.folder}"
    console.print(said, highlight=False, soft_wrap=True)
    return trained


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
    watch: Watch = lambda row: None,
    checkpoint: int = 0,
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
        checkpoint: decisions between checkpoints; 0 for none.

    Raises:
        InputError: another process writes into the folder.
    """
    assignment = Assignment(scenario.override(parameters.overrides), parameters, seed, provenance(sys.argv))
    with held(folder):
        assignment.save(folder)
        return _learn(assignment, folder, None, checkpoint, quiet, watch)


def finished(folder: Path) -> bool:
    """Whether a run has come to its end: one that is interrupted leaves its agent too, but with checkpoints."""
    return (folder / CARD).exists() and not has_checkpoint(folder)


def resume(folder: Path, checkpoint: int, quiet: bool = False) -> Run:
    """Go on with a run that was cut short: it ends as if it had not been, to the last bit.

    Args:
        folder: of the run.
        checkpoint: decisions between further checkpoints; 0 for none.
        quiet: no progress bar.

    Raises:
        InputError: no run, one that is finished, another process that writes into the folder.
        CheckpointError: the checkpoints are damaged.
    """
    assignment = Assignment.load(folder)
    with held(folder):
        if finished(folder):
            raise InputError(f"{folder} is finished: there is nothing to go on with")
        if not has_checkpoint(folder):
            return _learn(assignment, folder, None, checkpoint, quiet)
        saved, damaged = find_checkpoint(folder)
        for remark in damaged:
            print(f"passloc: {remark}; going on from the one before", file=sys.stderr)
        return _learn(assignment, folder, saved, checkpoint, quiet)


def _learn(
    assignment: Assignment,
    folder: Path,
    saved: Checkpoint | None,
    checkpoint: int,
    quiet: bool = False,
    watch: Watch = lambda row: None,
) -> Run:
    """Learn from the beginning, or from a checkpoint on."""
    torch.set_num_threads(1)
    scenario, parameters = assignment.scenario, assignment.parameters
    writable_folder(folder)
    env = learning_env(scenario, parameters, assignment.seed)
    model = build_ppo(env, parameters, assignment.seed)
    curve = CurveCallback(folder / CURVE, watch)
    if saved is not None:
        curve = CurveCallback(folder / CURVE, watch, *_put_back(saved, folder, model, env))
    progress = ProgressCallback(scenario.name, parameters.decisions, shown=not quiet)

    def state() -> dict[str, Any]:
        return {"learner": learner_state(model, env), "curve": curve.rows, "seconds": curve.seconds}

    keeper = CheckpointCallback(folder, checkpoint, state)
    interrupted: KeyboardInterrupt | None = None
    try:
        ahead = parameters.decisions - model.num_timesteps
        with event_log(folder) as logger:
            model.set_logger(logger)
            model.learn(ahead, callback=CallbackList([curve, progress, keeper]), reset_num_timesteps=saved is None)
    except KeyboardInterrupt as error:
        # What has been learnt so far is an agent all the same, and its card says how many decisions it has seen.
        interrupted = error
    finally:
        progress.stop()
        env.close()
    agent = agent_of(model, assignment, curve.seconds)
    agent.save(folder)
    note(folder, f"the agent after {model.num_timesteps:,} decisions")
    if interrupted is not None:
        raise interrupted
    forget_checkpoints(folder)
    return Run(folder, agent, curve.seconds, curve.rows)


def _put_back(
    saved: Checkpoint, folder: Path, model: VectorPPO, env: VecEnv
) -> tuple[Sequence[dict[str, float]], float]:
    """Let the learner be what it was; the rows of its curve, and how long it had learnt.

    Raises:
        CheckpointError: it was another one.
    """
    try:
        put_back(saved.tree["learner"], model, env)
        return saved.tree["curve"], float(saved.tree["seconds"])
    except (KeyError, TypeError, ValueError, AttributeError, RuntimeError) as error:
        reason = f"{type(error).__name__}: {one_line(error)}"
        raise CheckpointError(f"the checkpoint in {folder} is of another training or version: {reason}") from None


def _parameters(arguments: Train, scenario: Scenario) -> Hyperparameters:
    if arguments.hyperparameters is not None:
        parameters = Hyperparameters.load(arguments.hyperparameters)
    else:
        parameters = Hyperparameters.for_scenario(scenario.name)
    if arguments.decisions is not None:
        parameters = dataclasses.replace(parameters, decisions=arguments.decisions)
    return parameters


def main() -> None:
    """``python -m training.train``: the same as ``passloc train``."""
    from training.cli import main as command_line

    sys.exit(command_line(["train", *sys.argv[1:]]))


if __name__ == "__main__":
    main()
