"""PPO end to end: sensor steps per second while Stable-Baselines3 learns, in passloc and around the FilterPy peer.

Importing this module imports Stable-Baselines3 and PyTorch.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv, VecEnvWrapper

from passloc_env import Scenario
from passloc_env.sb3 import make_vec_env
from training.benchmark.filterpy_env import FilterPyEnv
from training.benchmark.report import Learner, Learning, spread
from training.hyperparameters import Hyperparameters
from training.vector_ppo import VectorPPO


@dataclass(frozen=True)
class Plan:
    """The settings of both sides.

    Attributes:
        environments: environments of passloc.
        steps: decisions per environment and rollout in passloc.
        peer_environments: environments of the peer, in SB3's DummyVecEnv.
        peer_steps: decisions per environment that the peer collects in a turn.
        batch: decisions per gradient step.
        epochs: passes over a rollout.
        layers: hidden units of policy and value network.
    """

    environments: int = 1024
    steps: int = 16
    peer_environments: int = 16
    peer_steps: int = 60
    batch: int = 8192
    epochs: int = 4
    layers: tuple[int, ...] = (64, 64)

    @classmethod
    def that_learns_best(cls, name: str) -> Plan:
        """With the hyperparameters of a scenario's shipped agent."""
        best = Hyperparameters.for_scenario(name)
        return cls(
            environments=best.environments,
            steps=best.rollout,
            batch=best.batch_size,
            epochs=best.epochs,
            layers=best.network,
        )

    @property
    def rollout(self) -> int:
        """Decisions per rollout."""
        return self.environments * self.steps

    @property
    def whole(self) -> bool:
        """Whether the peer collects a rollout of the same size, so that its own updates can be timed."""
        return self.peer_environments * self.peer_steps == self.rollout


@dataclass(frozen=True)
class Turn:
    """Seconds per sensor step of collecting, and per rollout of the update; per sensor step within the environment."""

    collecting: float
    updating: float
    flying: float = 0.0

    def share(self, sensor_steps: int) -> float:
        """The environment's share of the time that rollouts of so many sensor steps take."""
        return self.flying * self.per_second(sensor_steps)

    def per_second(self, sensor_steps: int) -> float:
        """Sensor steps per second for rollouts of so many."""
        return sensor_steps / (self.collecting * sensor_steps + self.updating)


class Side:
    """One PPO learner that is given turns."""

    def __init__(self, learner: type[PPO], env: VecEnv, steps: int, scenario: Scenario, plan: Plan) -> None:
        self._rollout = env.num_envs * steps
        self._decision_every = scenario.episode.decision_every
        self._stopwatch, self._timed = _Stopwatch(), _Timed(env)
        self._agent = learner(
            "MlpPolicy",
            self._timed,
            n_steps=steps,
            batch_size=min(plan.batch, self._rollout),
            n_epochs=plan.epochs,
            policy_kwargs={"net_arch": list(plan.layers)},
            device="cpu",
        )

    def turn(self, rollouts: int) -> Turn:
        """Learn from so many rollouts."""
        self._stopwatch.collecting = self._timed.flying = 0.0
        begun = time.perf_counter()
        decisions = rollouts * self._rollout
        self._agent.learn(decisions, callback=self._stopwatch, reset_num_timesteps=False)
        total = time.perf_counter() - begun
        collecting = self._stopwatch.collecting
        sensor_steps = decisions * self._decision_every
        return Turn(collecting / sensor_steps, (total - collecting) / rollouts, self._timed.flying / sensor_steps)


class _Timed(VecEnvWrapper):
    """Adds up the time within the environment."""

    flying = 0.0

    def reset(self) -> Any:
        """Begin new episodes."""
        return self.venv.reset()

    def step_async(self, actions: np.ndarray) -> None:
        """The step."""
        self._begun = time.perf_counter()
        self.venv.step_async(actions)

    def step_wait(self) -> Any:
        """What it came to."""
        found = self.venv.step_wait()
        self.flying += time.perf_counter() - self._begun
        return found


class _Stopwatch(BaseCallback):
    """Adds up the time of collecting rollouts."""

    collecting = 0.0

    def _on_rollout_start(self) -> None:
        self._begun = time.perf_counter()

    def _on_rollout_end(self) -> None:
        self.collecting += time.perf_counter() - self._begun

    def _on_step(self) -> bool:
        return True


def measure_learning(scenario: Scenario, rounds: int, plan: Plan) -> Learning:
    """Both sides in turns, on one PyTorch thread.

    Args:
        scenario: one that both can run.
        rounds: turns of each side; one of passloc lasts at least an episode, so that every turn has its share of
            resets.
        plan: the settings.
    """
    decisions = scenario.episode.steps // scenario.episode.decision_every
    rollouts = -(-decisions // plan.steps)
    sensor_steps = plan.rollout * scenario.episode.decision_every
    with _one_thread():
        ours = Side(VectorPPO, make_vec_env(scenario, plan.environments, seed=0), plan.steps, scenario, plan)
        peers = DummyVecEnv([lambda: FilterPyEnv(scenario)] * plan.peer_environments)
        peers.seed(0)
        theirs = Side(PPO, peers, plan.peer_steps, scenario, plan)
        ours.turn(1)
        theirs.turn(1)
        our_turns, their_turns = [], []
        for _ in range(rounds):
            our_turns.append(ours.turn(rollouts))
            turn = theirs.turn(1)
            # The same network updates on as many decisions, wherever they come from.
            updating = turn.updating if plan.whole else our_turns[-1].updating
            their_turns.append(replace(turn, updating=updating))
    ratios = [
        a.per_second(sensor_steps) / b.per_second(sensor_steps) for a, b in zip(our_turns, their_turns, strict=True)
    ]
    return Learning(
        scenario.name,
        rounds,
        plan.rollout,
        plan.batch,
        plan.epochs,
        [
            _learner("passloc, vector", plan.environments, our_turns, sensor_steps),
            _learner("FilterPy environment", plan.peer_environments, their_turns, sensor_steps),
        ],
        spread(ratios),
        _notes(plan),
    )


def _notes(plan: Plan) -> list[str]:
    notes = [
        "Time limits are bootstrapped on both sides, as SB3's own vector environments do.",
        "passloc learns with VectorPPO, whose rollouts look at no environment alone; the peer with SB3's PPO.",
    ]
    if not plan.whole:
        notes.append(
            f"The FilterPy environments collected {plan.peer_environments} × {plan.peer_steps} decisions a turn; their "
            f"rate is put together from that time per sensor step and the time of passloc's update on {plan.rollout} "
            "decisions, the same computation."
        )
    return notes


def _learner(name: str, environments: int, turns: list[Turn], sensor_steps: int) -> Learner:
    return Learner(
        name,
        environments,
        spread([turn.per_second(sensor_steps) for turn in turns]),
        spread([1.0 / turn.collecting for turn in turns]),
        spread([turn.updating for turn in turns]),
        spread([turn.share(sensor_steps) for turn in turns]),
    )


@contextmanager
def _one_thread() -> Iterator[None]:
    """PyTorch on one thread, and afterwards on as many as before."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(threads)
