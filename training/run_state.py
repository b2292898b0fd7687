"""What a training run keeps between two rollouts, bound to what it was asked for; and going on from it."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, field
from typing import Any

from stable_baselines3.common.vec_env import VecEnv

from passloc_env.errors import one_line
from training.checkpoint import Checkpoint, CheckpointError, ForeignCheckpointError
from training.curve import COLUMNS, CurveCallback
from training.learner_state import check_state, learner_state, put_back
from training.run_folder import CONFIGURATION, Assignment
from training.vector_ppo import VectorPPO


@dataclass(frozen=True)
class Memory:
    """What a run remembers beside its learner.

    Attributes:
        rows: of its learning curve.
        seconds: how long it has learnt.
        resumed: provenance of each time that it was gone on with elsewhere, or with other versions.
    """

    rows: list[dict[str, float]] = field(default_factory=list)
    seconds: float = 0.0
    resumed: list[dict[str, Any]] = field(default_factory=list)

    def told_by(self, assignment: Assignment) -> Assignment:
        """The assignment with an origin that says where it was gone on with, for the agent's card."""
        if not self.resumed:
            return assignment
        return dataclasses.replace(assignment, origin=assignment.origin | {"resumed": self.resumed})


def run_state(
    assignment: Assignment, model: VectorPPO, env: VecEnv, curve: CurveCallback, memory: Memory
) -> dict[str, Any]:
    """All of it, as a tree of arrays and plain data; curve and time as they are now."""
    return {
        "assignment": assignment.digest,
        "learner": learner_state(model, env),
        "curve": curve.rows,
        "seconds": curve.seconds,
        "resumed": memory.resumed,
    }


def take_up(checkpoint: Checkpoint, assignment: Assignment, model: VectorPPO, env: VecEnv) -> Memory:
    """Let a new learner be what it was; what the run remembers beside it.

    Raises:
        ForeignCheckpointError: the checkpoint is of another assignment.
        CheckpointError: it holds what no training of this version can have kept.
    """
    tree = checkpoint.tree
    if tree.get("assignment") != assignment.digest:
        raise ForeignCheckpointError(f"is of another training than {CONFIGURATION} beside it describes")
    try:
        memory = _memory(tree)
        check_state(tree["learner"], model, env)
        if tree["learner"]["counters"]["num_timesteps"] >= assignment.parameters.decisions:
            raise ValueError("it has learnt more than it was asked to")
        put_back(tree["learner"], model, env)
    except (ArithmeticError, AttributeError, LookupError, RuntimeError, TypeError, ValueError) as error:
        # Generators refuse impossible states each in its way.
        raise CheckpointError(f"is of another version or damaged: {type(error).__name__}: {one_line(error)}") from None
    return memory


def _memory(tree: dict[str, Any]) -> Memory:
    """ValueError unless there are a curve, a time and a list of provenances."""
    rows, seconds, resumed = tree["curve"], tree["seconds"], tree["resumed"]
    if not isinstance(rows, list) or not all(_is_row(row) for row in rows):
        raise ValueError("its curve is none")
    if not _is_number(seconds) or seconds < 0.0:
        raise ValueError("its seconds are not a time")
    if not isinstance(resumed, list) or not all(isinstance(each, dict) for each in resumed):
        raise ValueError("it does not say where it was resumed")
    return Memory(rows, seconds, resumed)


def _is_row(row: Any) -> bool:
    return isinstance(row, dict) and tuple(row) == COLUMNS and all(map(_is_number, row.values()))


def _is_number(value: Any) -> bool:
    return type(value) in (int, float) and math.isfinite(value)
