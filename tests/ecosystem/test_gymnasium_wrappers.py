"""Gymnasium's wrappers stacked, in tensors and in films; what each does by itself is a contract elsewhere."""

import gymnasium
import numpy as np
import pytest
from gymnasium import wrappers
from gymnasium.vector import VectorEnv
from gymnasium.wrappers import vector as vector_wrappers

from passloc_env import LocalisationEnv, LocalisationVectorEnv

ID, SIZE, DECISIONS = "passloc/BearingsOnly-v0", 3, 12
OVERRIDES = {"episode.steps": 20, "episode.early_end": False}


def tensors():
    """The module torch, and what Gymnasium needs to convert from it."""
    pytest.importorskip("array_api_compat")
    return pytest.importorskip("torch")


def prepared(envs: VectorEnv) -> VectorEnv:
    """What CleanRL puts around an environment with continuous actions, in its order."""
    envs = vector_wrappers.RecordEpisodeStatistics(envs)
    envs = vector_wrappers.ClipAction(envs)
    envs = vector_wrappers.NormalizeObservation(envs)
    envs = vector_wrappers.TransformObservation(envs, lambda observation: np.clip(observation, -10, 10))
    envs = vector_wrappers.NormalizeReward(envs, gamma=0.99)
    return vector_wrappers.ClipReward(envs, -10.0, 10.0)


def test_the_usual_stack_sees_the_same_in_both_vector_environments() -> None:
    kinds = ("sync", "vector_entry_point")
    made = [gymnasium.make_vec(ID, SIZE, vectorization_mode=kind, overrides=OVERRIDES) for kind in kinds]
    theirs, ours = map(prepared, made)
    rng, ended = np.random.default_rng(0), 0
    np.testing.assert_array_equal(theirs.reset(seed=1)[0], ours.reset(seed=1)[0])
    for _ in range(DECISIONS):
        action = rng.uniform(-2, 2, (SIZE, 1)).astype(np.float32)
        expected, found = theirs.step(action), ours.step(action)
        for one, other in zip(expected[:4], found[:4], strict=True):
            np.testing.assert_array_equal(one, other)
        if "episode" in found[4]:
            ended += found[4]["_episode"].sum()
            np.testing.assert_array_equal(expected[4]["episode"]["r"], found[4]["episode"]["r"])
    assert ended == 2 * SIZE


# In mode SameStep Gymnasium cannot convert the last observations, neither ours nor those of its own environments.
def test_vector_tensors() -> None:
    torch = tensors()
    from gymnasium.wrappers.vector import NumpyToTorch

    plain, other = (LocalisationVectorEnv(SIZE, overrides=OVERRIDES) for _ in range(2))
    envs = NumpyToTorch(other)
    first, _ = envs.reset(seed=1)
    assert torch.equal(first, torch.tensor(plain.reset(seed=1)[0]))
    for _ in range(6):
        expected, found = plain.step(np.full((SIZE, 1), 0.5, np.float32)), envs.step(torch.full((SIZE, 1), 0.5))
        for ours, theirs in zip(expected[:4], found[:4], strict=True):
            assert isinstance(theirs, torch.Tensor)
            np.testing.assert_array_equal(theirs.numpy(), ours)


def test_scalar_tensors() -> None:
    torch = tensors()
    from gymnasium.wrappers import NumpyToTorch

    plain, env = LocalisationEnv(overrides=OVERRIDES), NumpyToTorch(LocalisationEnv(overrides=OVERRIDES))
    assert torch.equal(env.reset(seed=1)[0], torch.tensor(plain.reset(seed=1)[0]))
    expected, found = plain.step(np.full(1, 0.5, np.float32)), env.step(torch.full((1,), 0.5))
    np.testing.assert_array_equal(found[0].numpy(), expected[0])
    assert found[1:4] == expected[1:4]


def test_a_stack_of_scalar_wrappers_is_made_again_from_its_specification() -> None:
    features = LocalisationEnv().observation_space.shape
    rescale = (np.full(features, -1, np.float32), np.full(features, 1, np.float32))
    env = wrappers.FrameStackObservation(
        wrappers.RescaleObservation(gymnasium.make(ID, overrides=OVERRIDES, max_episode_steps=3), *rescale), 2
    )
    again = gymnasium.make(env.spec)
    assert again.observation_space == env.observation_space
    plain = LocalisationEnv(overrides=OVERRIDES)
    first, _ = plain.reset(seed=1)
    for stack in (env, again):
        np.testing.assert_allclose(stack.reset(seed=1)[0], np.stack([first, first]) / 10.0, atol=1e-6)
    action = np.full(1, 0.5, np.float32)
    for _ in range(3):
        results = [stack.step(action) for stack in (env, again)]
        np.testing.assert_array_equal(results[0][0], results[1][0])
    assert [result[3] for result in results] == [True, True]


def test_a_film_of_an_episode(tmp_path) -> None:
    pytest.importorskip("moviepy")
    pytest.importorskip("pygame")
    env = wrappers.RecordVideo(
        gymnasium.make(ID, overrides=OVERRIDES, render_mode="rgb_array"), str(tmp_path / "films"), disable_logger=True
    )
    env.reset(seed=1)
    while not env.step(np.full(1, 0.5, np.float32))[3]:
        assert len(env.recorded_frames) >= 2
    env.close()
    film = tmp_path / "films/rl-video-episode-0.mp4"
    assert film.stat().st_size > 1_000
