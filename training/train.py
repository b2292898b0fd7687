"""Training PPO on the native vector environment; ``passloc train`` and ``python -m training.train``."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch
from stable_baselines3.common.callbacks import BaseCallback, CallbackList
from stable_baselines3.common.vec_env import VecEnv

from agents.agent_file import CARD, AgentFile
from agents.symmetry import MirrorSymmetry
from passloc_env.errors import InputError
from passloc_env.scenario import Scenario
from passloc_env.scenarios import find
from training.arguments import check_seed, file_stem, new_folder, parse_overrides, writable_folder
from training.checkpoint import find_checkpoint, forget_checkpoints, has_checkpoint
from training.checkpoint_callback import CheckpointCallback
from training.commands import Train
from training.curve import CurveCallback
from training.event_log import event_log
from training.families import families_of
from training.files import note
from training.hyperparameters import Hyperparameters
from training.learner import agent_of, build_ppo, learning_env
from training.learner_state import has_learnt
from training.lock import held
from training.mishaps import told
from training.progress import console
from training.progress_callback import ProgressCallback
from training.provenance import provenance, same_place
from training.run_folder import CURVE, Assignment, check_own_files
from training.run_state import Memory, run_state, take_up
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
        return _learn(assignment, folder, checkpoint, quiet, watch)


def finished(folder: Path) -> bool:
    """Whether a run has come to its end: one that is interrupted leaves its agent too, of fewer decisions.

    Raises:
        InputError: the folder holds no run, or an unreadable one.
    """
    if has_checkpoint(folder) or not (folder / CARD).exists():
        return False
    return _learnt(folder) >= Assignment.load(folder).parameters.decisions


def _learnt(folder: Path) -> int:
    """The decisions that the agent in a run folder has learnt from, as its card says."""
    training = AgentFile.load(folder).card.get("training", {})
    decisions = training.get("decisions")
    return decisions if isinstance(decisions, int) else 0


def resume(folder: Path, checkpoint: int, quiet: bool = False) -> Run:
    """Go on with a run that was cut short: it ends as if it had not been, to the last bit.

    That holds on the same machine with the same versions; a run that is gone on with elsewhere says so in its card.

    Args:
        folder: of the run.
        checkpoint: decisions between further checkpoints; 0 for none.
        quiet: no progress bar.

    Raises:
        InputError: no run, one that is finished or has kept nothing to go on from, links in its folder, another process
            that writes into it.
        CheckpointError: the checkpoints are damaged, or of another run.
    """
    assignment = Assignment.load(folder)
    check_own_files(folder)
    with held(folder):
        if finished(folder):
            raise InputError(f"{folder} is finished: there is nothing to go on with")
        if has_checkpoint(folder):
            return _learn(assignment, folder, checkpoint, quiet, going_on=True)
        if (folder / CARD).exists():
            done = f"{_learnt(folder):,} of {assignment.parameters.decisions:,} decisions"
            raise InputError(f"{folder} was cut short after {done} and kept no checkpoint to go on from")
        here = provenance(sys.argv)
        begun = assignment.origin | {name: here[name] for name in ("versions", "machine")}
        assignment = dataclasses.replace(assignment, origin=begun)
        assignment.save(folder)
        return _learn(assignment, folder, checkpoint, quiet)


def _learn(
    assignment: Assignment,
    folder: Path,
    checkpoint: int,
    quiet: bool = False,
    watch: Watch = lambda row: None,
    going_on: bool = False,
) -> Run:
    """Learn from the beginning, or from a checkpoint on."""
    torch.set_num_threads(1)
    parameters = assignment.parameters
    writable_folder(folder)
    progress = ProgressCallback(assignment.scenario.name, parameters.decisions, shown=not quiet)
    with closing(learning_env(assignment.scenario, parameters, assignment.seed)) as env, closing(progress):
        model = build_ppo(env, parameters, assignment.seed)
        memory = _remembered(assignment, folder, model, env) if going_on else Memory()
        curve = CurveCallback(folder / CURVE, watch, memory.rows, memory.seconds)
        keeper = CheckpointCallback(folder, checkpoint, lambda: run_state(assignment, model, env, curve, memory))
        with told(folder, model, parameters.learning_rate):
            interrupted = _interruption(model, folder, parameters.decisions, [curve, progress, keeper], going_on)
            if interrupted is not None and not has_learnt(model):
                raise interrupted
            agent = agent_of(model, memory.told_by(assignment), curve.seconds)
            agent.save(folder)
    note(folder, f"the agent after {model.num_timesteps:,} decisions")
    if interrupted is not None:
        raise interrupted
    forget_checkpoints(folder)
    return Run(folder, agent, curve.seconds, curve.rows)


def _interruption(
    model: VectorPPO, folder: Path, decisions: int, callbacks: list[BaseCallback], going_on: bool
) -> KeyboardInterrupt | None:
    """Learn until so many decisions have been seen; what has interrupted it, if anything.

    What has been learnt until then is an agent all the same, and its card says how many decisions it has seen.
    """
    try:
        with event_log(folder) as logger:
            model.set_logger(logger)
            ahead = decisions - model.num_timesteps
            model.learn(ahead, callback=CallbackList(callbacks), reset_num_timesteps=not going_on)
    except KeyboardInterrupt as error:
        return error
    return None


def _remembered(assignment: Assignment, folder: Path, model: VectorPPO, env: VecEnv) -> Memory:
    """Take up the latest usable checkpoint of a run, and say what is not as it was."""
    memory, damaged = find_checkpoint(folder, lambda found: take_up(found, assignment, model, env))
    for remark in damaged:
        print(f"passloc: {remark}; going on from the one before", file=sys.stderr)
    here = provenance(sys.argv)
    if same_place([assignment.origin, *memory.resumed][-1], here):
        return memory
    said = f"{folder} was begun with other versions or on another machine, as its card will say"
    print(f"passloc: {said}: it may end otherwise than there", file=sys.stderr)
    return dataclasses.replace(memory, resumed=[*memory.resumed, here])


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
