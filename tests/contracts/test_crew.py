"""A batch on several processes is the batch on one, and says so when a process is gone."""

import os
import signal

import numpy as np
import pytest

from passloc_env import LocalisationVectorEnv
from passloc_env.batch import Batch
from passloc_env.crew import CrewBatch, build_batch
from passloc_env.errors import WorkerError
from passloc_env.scenarios import find

SIZE = 1030
"""Enough for two workers to pay, and not even."""

SHORT = {"episode.steps": 12}


@pytest.fixture
def crew():
    """Environments on two processes, closed afterwards."""
    built = []

    def build(**options):
        built.append(LocalisationVectorEnv(SIZE, "BearingDoppler", overrides=SHORT, workers=2, **options))
        assert isinstance(built[-1].batch, CrewBatch)
        return built[-1]

    yield build
    for env in built:
        env.close()


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_two_workers_fly_what_one_flies(mode, crew, actions, assert_same):
    """Over the ends of episodes, with seeds, infos, beliefs and snapshots."""
    ours = crew(autoreset_mode=mode, diagnostics=True)
    theirs = LocalisationVectorEnv(SIZE, "BearingDoppler", overrides=SHORT, autoreset_mode=mode, diagnostics=True)
    assert_same(ours.reset(seed=3), theirs.reset(seed=3))
    stream = actions(SIZE, 1)
    for step in range(5):
        action = next(stream)
        assert_same(ours.step(action), theirs.step(action), f"step {step}")
    assert_same(ours.belief.covariance, theirs.belief.covariance)
    saved, action = ours.get_state(), next(stream)
    after = ours.step(action)
    ours.set_state(saved)
    assert_same(ours.step(action), after)
    theirs.set_state(saved)
    assert_same(theirs.step(action), after)


def test_some_are_reset(crew, assert_same):
    ours = crew(autoreset_mode="Disabled")
    theirs = LocalisationVectorEnv(SIZE, "BearingDoppler", overrides=SHORT, autoreset_mode="Disabled")
    for env in (ours, theirs):
        env.reset(seed=1)
    mask = np.arange(SIZE) % 400 == 7
    seeds = [index if index % 3 else None for index in range(SIZE)]
    found, expected = (env.reset(seed=seeds, options={"reset_mask": mask}) for env in (ours, theirs))
    assert_same(found, expected)


def test_a_state_that_does_not_fit_changes_nothing(crew, assert_same):
    env = crew()
    env.reset(seed=0)
    before = env.get_state()
    broken = env.get_state()
    broken["arrays"]["track.mean"] = broken["arrays"]["track.mean"][:3]
    with pytest.raises(ValueError, match=r"the state does not fit this environment: track\.mean is \(3, "):
        env.set_state(broken)
    assert_same(env.get_state()["arrays"], before["arrays"])


def test_a_worker_that_dies_is_an_error_and_no_hang(crew):
    env = crew()
    env.reset(seed=0)
    (worker,) = env.batch.workers
    os.kill(worker.process.pid, signal.SIGKILL)
    worker.process.join(10.0)
    first = worker.share.start
    assert SIZE // 2 <= first < SIZE
    expected = rf"worker 2 of 2 has died \(exit code -9\) and with it environments {first} to 1029: the batch is lost"
    for _ in range(2):
        with pytest.raises(WorkerError, match=expected):
            env.step(np.zeros((SIZE, 1), np.float32))


def test_closing_sends_the_workers_home(crew):
    env = crew()
    (worker,) = env.batch.workers
    env.close()
    worker.process.join(10.0)
    assert not worker.process.is_alive()


def test_the_worlds_of_others_cannot_be_watched(crew):
    with pytest.raises(ValueError, match="build the environment with workers=1"):
        _ = crew().batch.tiles


@pytest.mark.parametrize(("size", "workers"), [(100, 8), (1023, 2), (1024, 1)])
def test_small_batches_stay_in_one_process(size, workers):
    assert isinstance(build_batch(find("BearingDoppler"), size, workers), Batch)


@pytest.mark.parametrize("workers", [0, -1, 1.5, True, "two"])
def test_impossible_numbers_of_workers(workers):
    with pytest.raises(ValueError, match=f"workers = {workers!r} is not possible: must be a whole number"):
        LocalisationVectorEnv(4, workers=workers)
