"""The same seed gives the same episode to the last bit: alone, in any batch, in SyncVectorEnv, in another process."""

import hashlib
import inspect
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from passloc_env import SCENARIOS, LocalisationEnv, LocalisationVectorEnv
from passloc_env.batch import TILE

ROOT = Path(__file__).parents[2]
DECISIONS = {1: 20, 3: 16, 17: 10}
"""Decisions flown by batch size: several episodes each."""


@pytest.mark.parametrize("num_envs", DECISIONS)
@pytest.mark.parametrize("mode", ["NextStep", "SameStep", "Disabled"])
@pytest.mark.parametrize("name", SCENARIOS)
def test_vector_is_gymnasiums_sync_vector(name, mode, num_envs, short, vector_env, actions, assert_same):
    native = vector_env(num_envs, name, mode)
    synced = SyncVectorEnv(
        [lambda: LocalisationEnv(name, overrides=short(name), diagnostics=True)] * num_envs,
        autoreset_mode=AutoresetMode(mode),
    )
    assert native.observation_space == synced.observation_space
    assert native.action_space == synced.action_space

    assert_same(native.reset(seed=3), synced.reset(seed=3), "reset")
    terminations = truncations = 0
    stream = actions(num_envs, native.scenario.action_size)
    for decision in range(DECISIONS[num_envs]):
        action = next(stream)
        ours = native.step(action)
        assert_same(ours, synced.step(action), f"decision {decision}")
        terminations, truncations = terminations + ours[2].sum(), truncations + ours[3].sum()
        ended = ours[2] | ours[3]
        if mode == "Disabled" and ended.any():
            ours = native.reset(options={"reset_mask": ended})
            assert_same(ours, synced.reset(options={"reset_mask": ended}), f"reset after {decision}")
    assert terminations + truncations >= 2 * num_envs
    if num_envs == 17:
        assert terminations > 0
        assert truncations > 0


def test_every_tracker_is_the_same_in_every_batch(tracker, vector_env, actions, rows, assert_same):
    """Alone, in pairs and in sevens, with missed detections and noise of one's own."""
    changes = {"tracker": tracker, "sensors.0.detection_probability": 0.6}
    changes["sensors.0.sigma"] = {"type": "Uniform", "low": 1e-3, "high": 1e-2}
    whole, *parts = (vector_env(size, "BearingDoppler", "SameStep", **changes) for size in (7, 1, 2))
    batched, singles = whole.reset(seed=3), [part.reset(seed=3) for part in parts]
    stream, ends = actions(7, whole.scenario.action_size), 0
    for _ in range(6):
        for part, single in zip(parts, singles, strict=True):
            some = slice(0, part.num_envs)
            assert_same(rows(batched, some, like=single), single)
            assert_same(whole.belief.covariance[..., some].copy(), part.belief.covariance.copy())
        action = next(stream)
        batched, singles = whole.step(action), [part.step(action[: part.num_envs]) for part in parts]
        ends += (batched[2] | batched[3]).sum()
    assert ends >= 7


@pytest.mark.parametrize("name", SCENARIOS)
def test_scalar_is_a_row_of_the_vector(name, short, vector_env, actions, assert_same):
    row, seed = 3, 11
    vector, scalar = vector_env(5, name), LocalisationEnv(name, overrides=short(name), diagnostics=True)

    def assert_row(batched, single):
        for ours, theirs in zip(batched, single, strict=True):
            if isinstance(theirs, dict):
                assert_row([ours[key] for key in theirs], list(theirs.values()))
            else:
                assert np.asarray(theirs).tobytes() == ours[row].tobytes()

    assert_row(vector.reset(seed=seed), scalar.reset(seed=seed + row))
    stream, ended, flown = actions(5, vector.scenario.action_size), False, 0
    while not ended:
        action = next(stream)
        batched, single = vector.step(action), scalar.step(action[row])
        assert_row(batched, single)
        assert_same(vector.belief.mean[:, [row]], scalar.belief.mean)
        assert_same(vector.belief.covariance[..., [row]], scalar.belief.covariance)
        ended, flown = single[2] or single[3], flown + 1
    assert 1 <= flown <= 4


def assert_belief_is_part(whole, part, own, assert_same):
    """The belief of a batch holds that of a slice of it, joined over tiles or not."""
    pairs = [(getattr(whole, key), getattr(own, key)) for key in ("time", "time_left", "mean", "covariance", "range")]
    for key in ("position", "velocity", "acceleration", "attitude", "attitude_rate", "heading", "turn_rate"):
        pairs.append((getattr(whole.poses[0], key), getattr(own.poses[0], key)))
    pairs.append((whole.platforms[0].speed, own.platforms[0].speed))
    for joined, single in pairs:
        assert_same(joined[..., part].copy(), single.copy())
    assert (whole.interval, whole.period) == (own.interval, own.period)
    assert (whole.sensors, whole.motion) == (own.sensors, own.motion)


def test_tiles_change_nothing(vector_env, actions, rows, assert_same):
    name, size = "BearingDopplerUnknownCarrier", max(2500, TILE + 452)
    ends_soon = {"episode.lost_error": 0.3}
    whole = vector_env(size, name, "SameStep", **ends_soon)
    assert len(whole.batch.tiles) > 1
    slices = [slice(0, 3), slice(TILE - 2, TILE + 3), slice(size - 1, size)]
    parts = [(part, vector_env(part.stop - part.start, name, "SameStep", **ends_soon)) for part in slices]

    batched = whole.reset(seed=100)
    singles = [env.reset(seed=100 + part.start) for part, env in parts]
    stream, ends = actions(size), 0
    for _ in range(6):
        for (part, env), single in zip(parts, singles, strict=True):
            # The final observation is there only where somebody of the batch has ended.
            assert_same(rows(batched, part, like=single), single)
            assert_belief_is_part(whole.belief, part, env.belief, assert_same)
        action = next(stream)
        batched, singles = whole.step(action), [env.step(action[part]) for part, env in parts]
        ends += sum((single[2] | single[3]).sum() for single in singles)
    assert ends >= 5


@pytest.mark.parametrize("name", SCENARIOS)
def test_order_of_the_batch_changes_nothing(name, vector_env, actions, assert_same):
    order = np.array([3, 0, 4, 1, 2])
    straight, shuffled = vector_env(5, name, "SameStep"), vector_env(5, name, "SameStep")
    straight.reset(seed=[50, 51, 52, 53, 54])
    shuffled.reset(seed=[53, 50, 54, 51, 52])
    stream, ends = actions(5, straight.scenario.action_size), 0
    for _ in range(8):
        action = next(stream)
        a, b = straight.step(action), shuffled.step(action[order])
        assert_same([part[order] for part in a[:4]], list(b[:4]))
        ends += (a[2] | a[3]).sum()
    assert ends >= 5


def fingerprints(overrides):
    """Digest of a few episodes of each scenario; runs here and, as text, in another process."""
    digests = {}
    for name, changes in overrides.items():
        env, digest = LocalisationVectorEnv(5, name, overrides=changes, diagnostics=True), hashlib.sha256()
        env.reset(seed=8)
        for action in np.random.default_rng(0).uniform(-1, 1, (12, 5, env.scenario.action_size)):
            observation, reward, terminated, truncated, info = env.step(action)
            for part in (observation, reward, terminated, truncated, info["estimate"], info["truth"]):
                digest.update(part.tobytes())
        digests[name] = digest.hexdigest()
    return digests


def test_fresh_process_gives_the_same_bytes(short):
    overrides = {name: short(name) for name in SCENARIOS}
    program = [
        "import hashlib, json, sys\nimport numpy as np\nfrom passloc_env import LocalisationVectorEnv\n",
        inspect.getsource(fingerprints),
        "print(json.dumps(fingerprints(json.load(sys.stdin))))",
    ]
    answer = subprocess.run(
        [sys.executable, "-W", "error", "-c", "\n".join(program)],
        input=json.dumps(overrides),
        env={**os.environ, "PYTHONPATH": str(ROOT), "PYTHONHASHSEED": "7"},
        capture_output=True,
        text=True,
        check=True,
    )
    here = fingerprints(overrides)
    assert json.loads(answer.stdout) == here
    assert len(set(here.values())) == len(SCENARIOS)


@pytest.mark.parametrize("name", SCENARIOS)
def test_other_seeds_give_other_episodes(name):
    env = LocalisationVectorEnv(4, name)
    first, _ = env.reset(seed=0)
    assert len({row.tobytes() for row in first}) == 4
    again, _ = env.reset(seed=1)
    assert again[:3].tobytes() == first[1:].tobytes()
    fresh, _ = env.reset()
    assert not {row.tobytes() for row in fresh} & {row.tobytes() for row in first}
