"""A loop in the manner of CleanRL's single file learns the same in Gymnasium's vector environment and in ours."""

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import SyncVectorEnv, VectorEnv
from gymnasium.wrappers.vector import RecordEpisodeStatistics

import passloc_env

torch = pytest.importorskip("torch")

MODES = {"sync": SyncVectorEnv, "vector_entry_point": passloc_env.LocalisationVectorEnv}
ENVIRONMENTS, STEPS, ITERATIONS, EPISODE = 4, 12, 3, 5
DISCOUNT, TRACE_DECAY, CLIP = 0.99, 0.95, 0.2


class Agent(torch.nn.Module):
    """Actor and critic, and the actor's deviation."""

    def __init__(self, envs: VectorEnv) -> None:
        super().__init__()
        features, controls = envs.single_observation_space.shape[0], envs.single_action_space.shape[0]
        self.actor = torch.nn.Sequential(torch.nn.Linear(features, 16), torch.nn.Tanh(), torch.nn.Linear(16, controls))
        self.critic = torch.nn.Sequential(torch.nn.Linear(features, 16), torch.nn.Tanh(), torch.nn.Linear(16, 1))
        self.log_sigma = torch.nn.Parameter(torch.zeros(controls))

    def policy(self, observation: torch.Tensor) -> torch.distributions.Normal:
        return torch.distributions.Normal(self.actor(observation), self.log_sigma.exp())


class Rollout:
    """What the agent met in one iteration, ``(STEPS, ENVIRONMENTS, …)``."""

    def __init__(self, envs: VectorEnv) -> None:
        lead = (STEPS, ENVIRONMENTS)
        self.observations = torch.zeros(lead + envs.single_observation_space.shape)
        self.actions = torch.zeros(lead + envs.single_action_space.shape)
        self.logs, self.rewards, self.dones, self.values = (torch.zeros(lead) for _ in range(4))

    def advantages(self, last_value: torch.Tensor, last_done: torch.Tensor) -> torch.Tensor:
        """Generalised advantage estimates."""
        result, running = torch.zeros_like(self.rewards), torch.zeros(ENVIRONMENTS)
        for step in reversed(range(STEPS)):
            final = step == STEPS - 1
            going = 1.0 - (last_done if final else self.dones[step + 1])
            ahead = last_value if final else self.values[step + 1]
            delta = self.rewards[step] + DISCOUNT * ahead * going - self.values[step]
            result[step] = running = delta + DISCOUNT * TRACE_DECAY * going * running
        return result


def learn(mode: str) -> tuple[Agent, list[float]]:
    """PPO for a few iterations; the agent, and the returns of the episodes that ended."""
    overrides = {"episode.steps": 4 * EPISODE, "episode.early_end": False}
    envs = gymnasium.make_vec(
        "passloc/BearingsOnly-v0", num_envs=ENVIRONMENTS, vectorization_mode=mode, overrides=overrides
    )
    assert isinstance(envs.unwrapped, MODES[mode])
    envs = RecordEpisodeStatistics(envs)
    torch.manual_seed(0)
    agent, returns = Agent(envs), []
    optimizer = torch.optim.Adam(agent.parameters(), lr=1e-3)
    observation, done = torch.tensor(envs.reset(seed=1)[0]), torch.zeros(ENVIRONMENTS)
    for _ in range(ITERATIONS):
        rollout = Rollout(envs)
        for step in range(STEPS):
            with torch.no_grad():
                policy = agent.policy(observation)
                action = policy.sample()
                rollout.observations[step], rollout.dones[step], rollout.actions[step] = observation, done, action
                rollout.logs[step] = policy.log_prob(action).sum(-1)
                rollout.values[step] = agent.critic(observation)[:, 0]
            seen, reward, terminated, truncated, infos = envs.step(action.numpy())
            rollout.rewards[step] = torch.tensor(reward)
            observation, done = torch.tensor(seen), torch.tensor(terminated | truncated, dtype=torch.float32)
            if "episode" in infos:
                returns += infos["episode"]["r"][infos["_episode"]].tolist()
        update(agent, optimizer, rollout, observation, done)
    envs.close()
    return agent, returns


def update(agent, optimizer, rollout: Rollout, observation: torch.Tensor, done: torch.Tensor) -> None:
    """One pass over the rollout."""
    with torch.no_grad():
        advantages = rollout.advantages(agent.critic(observation)[:, 0], done)
        returns = advantages + rollout.values
        advantages = (advantages - advantages.mean()) / advantages.std()
    logs = agent.policy(rollout.observations).log_prob(rollout.actions).sum(-1)
    ratio = (logs - rollout.logs).exp()
    gain = torch.min(ratio * advantages, ratio.clamp(1.0 - CLIP, 1.0 + CLIP) * advantages)
    miss = agent.critic(rollout.observations)[..., 0] - returns
    optimizer.zero_grad()
    (0.5 * miss.square().mean() - gain.mean()).backward()
    torch.nn.utils.clip_grad_norm_(agent.parameters(), 0.5)
    optimizer.step()


def test_both_vector_environments_teach_the_same() -> None:
    learnt = {mode: learn(mode) for mode in MODES}
    (agent, returns), (ours, our_returns) = learnt.values()
    # The step after an end begins anew, so an episode takes one step more than it has decisions.
    assert len(returns) == ENVIRONMENTS * (ITERATIONS * STEPS // (EPISODE + 1))
    assert np.isfinite(returns).all()
    assert our_returns == returns
    for theirs, own in zip(agent.parameters(), ours.parameters(), strict=True):
        assert torch.equal(theirs, own)


def test_the_loop_learns_at_all() -> None:
    torch.manual_seed(0)
    envs = passloc_env.LocalisationVectorEnv(1)
    before, after = Agent(envs), learn("vector_entry_point")[0]
    assert all(not torch.equal(a, b) for a, b in zip(before.parameters(), after.parameters(), strict=True))
