"""PPO end to end: sensor steps per second while Stable-Baselines3 learns, in passloc and around the FilterPy peer.

Importing this module imports Stable-Baselines3 and PyTorch.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv

from passloc_env import Scenario
from passloc_env.sb3 import make_vec_env
from training.benchmark.filterpy_env import FilterPyEnv
from training.benchmark.report import Learner, Learning, spread


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
    """Seconds per sensor step of collecting, and per rollout of the update."""

    collecting: float
    updating: float

    def per_second(self, sensor_steps: int) -> float:
        """Sensor steps per second for rollouts of so many."""
        return sensor_steps / (self.collecting * sensor_steps + self.updating)


class Side:
    """One PPO learner that is given turns."""

    def __init__(self, env: VecEnv, steps: int, scenario: Scenario, plan: Plan) -> None:
        self._rollout = env.num_envs * steps
        self._decision_every = scenario.episode.decision_every
        self._stopwatch = _Stopwatch()
        self._agent = PPO(
            "MlpPolicy",
            env,
            n_steps=steps,
            batch_size=min(plan.batch, self._rollout),
            n_epochs=plan.epochs,
            policy_kwargs={"net_arch": list(plan.layers)},
            device="cpu",
        )

    def turn(self, rollouts: int) -> Turn:
        """Learn from so many rollouts."""
        self._stopwatch.collecting = 0.0
        begun = time.perf_counter()
        decisions = rollouts * self._rollout
        self._agent.learn(decisions, callback=self._stopwatch, reset_num_timesteps=False)
        total = time.perf_counter() - begun
        collecting = self._stopwatch.collecting
        return Turn(collecting / (decisions * self._decision_every), (total - collecting) / rollouts)


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
        ours = Side(make_vec_env(scenario, plan.environments, seed=0), plan.steps, scenario, plan)
        peers = DummyVecEnv([lambda: FilterPyEnv(scenario)] * plan.peer_environments)
        peers.seed(0)
        theirs = Side(peers, plan.peer_steps, scenario, plan)
        ours.turn(1)
        theirs.turn(1)
        our_turns, their_turns = [], []
        for _ in range(rounds):
            our_turns.append(ours.turn(rollouts))
            turn = theirs.turn(1)
            # The same network updates on as many decisions, wherever they come from.
            updating = turn.updating if plan.whole else our_turns[-1].updating
            their_turns.append(Turn(turn.collecting, updating))
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
    notes = ["Time limits are bootstrapped on both sides, as SB3's own vector environments do."]
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
