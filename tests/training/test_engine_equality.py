"""The same results, to the last bit, whatever the engine, the number of workers and the size of batches."""

import dataclasses
import json
import os
import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

from work_for_engines import PLACE, MortalCircle, marks

from agents import AgentFile, find_policy
from passloc_env import SCENARIOS
from training import episodes as episodes_module
from training import tune as tune_module
from training.candidate import Candidate, train_missing
from training.commands import Leaderboard, Tune
from training.commands.fields import Work
from training.curve import read_curve
from training.engines import ALONE, opened
from training.engines.local import Local
from training.evaluate import evaluate
from training.hyperparameters import Hyperparameters
from training.leaderboard import Variant, board, leaderboard
from training.papers import dual_array
from training.papers.monte_carlo import run
from training.papers.moving_cross_fix import reproduce_in_the_environment
from training.papers.reproduction import Reproduction
from training.tune import tune

SHORT = SCENARIOS["BearingsOnly"].override({"episode.steps": 24})
TINY = Hyperparameters(environments=8, rollout=16, batch_size=32, epochs=4, network=(8,), decisions=256)
EPISODES, SEED = 11, 70
TIMED = "milliseconds_per_decision"


@pytest.fixture(scope="module", autouse=True)
def logs(tmp_path_factory):
    """No log folder of SB3's."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SB3_LOGDIR", str(tmp_path_factory.mktemp("logs")))
        yield


@pytest.fixture(scope="module")
def two():
    engine = Local(2)
    yield engine
    engine.close()


@pytest.fixture(scope="module", params=[1, 2, 3])
def engine(request, two):
    if request.param == 2:
        yield two
        return
    other = Local(request.param)
    yield other
    other.close()


def same_scores(found, expected):
    assert list(found) == list(expected)
    for policy, scores in expected.items():
        for name, values in vars(scores).items():
            np.testing.assert_array_equal(getattr(found[policy], name), values, err_msg=f"{policy}: {name}")


def untimed(evaluation):
    return [{**dataclasses.asdict(verdict), TIMED: None} for verdict in evaluation.verdicts]


def test_evaluate(engine, monkeypatch):
    """With a policy that draws, one that is a network, and one that is told the truth."""
    policies = [find_policy(name, SHORT) for name in ("circle", "random", "learned", "greedy-truth")]
    expected = evaluate(SHORT, policies, EPISODES, SEED)
    found = evaluate(SHORT, policies, EPISODES, SEED, engine=engine)
    same_scores(found.scores, expected.scores)
    assert untimed(found) == untimed(expected)
    monkeypatch.setattr(episodes_module, "CHUNK", 2)
    same_scores(evaluate(SHORT, policies, EPISODES, SEED, engine=engine).scores, expected.scores)


def test_progress_counts_every_episode_once(two):
    counted = dict.fromkeys(("circle", "straight"), 0)

    def progress(policy, done):
        counted[policy] += done

    evaluate(SHORT, [find_policy(name, SHORT) for name in counted], EPISODES, SEED, progress, two)
    assert set(counted.values()) == {EPISODES}


def test_leaderboard(tmp_path, monkeypatch):
    own = SCENARIOS["OwnShipModerate"].override({"episode.steps": 4})
    tiny = (Variant("Tiny", "BearingsOnly, tiny", SHORT), Variant("Own", "OwnShipModerate, tiny", own))
    monkeypatch.setattr(board, "variants", lambda names: tiny)
    kept = {}
    for workers in (1, 2):
        folder = tmp_path / str(workers)
        leaderboard(
            Leaderboard(
                policies="circle,random,greedy",
                episodes=EPISODES,
                seed=SEED,
                out=folder / "page",
                cache=folder / "kept",
                work=Work(workers=workers),
            )
        )
        kept[workers] = {}
        for path in sorted((folder / "kept").rglob("*.npz")):
            with np.load(path, allow_pickle=False) as file:
                arrays = {name: file[name] for name in file.files if name != "seconds"}
            kept[workers][path.relative_to(folder / "kept").as_posix()] = arrays
    assert kept[1].keys() == kept[2].keys()
    assert len(kept[1]) == 6
    for path, arrays in kept[1].items():
        for name, values in arrays.items():
            np.testing.assert_array_equal(kept[2][path][name], values, err_msg=f"{path}: {name}")


def test_reproduce(engine):
    """The part of paper 004 that is flown as episodes: claims and tables, in their last digit."""
    alone, found = (Reproduction("cross-fix", Path(), 7, SEED, place) for place in (ALONE, engine))
    for made in (alone, found):
        reproduce_in_the_environment(made, (0.6, 0.8, 0.9, 0.95), 7)
    assert found.to_dict() == alone.to_dict()
    assert alone.tables


def test_histories_with_quantities_of_a_paper(engine):
    scenario = dual_array.NEAR.scenario().override({"episode.steps": 20})
    expected, found = (run(scenario, 5, SEED, every=4, extra=dual_array._EXTRA, engine=e) for e in (ALONE, engine))
    assert found.extra.keys() == dual_array._EXTRA.keys()
    for name in ("time", "error", "bound", "range", "nees"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
    for name, values in expected.extra.items():
        np.testing.assert_array_equal(found.extra[name], values)
    assert found.states == expected.states


def test_seeds(tmp_path, two):
    """Agents that were trained elsewhere are those that are trained here, file by file."""
    made = {}
    for name, engine in (("here", ALONE), ("there", two)):
        out = tmp_path / name
        candidates = [Candidate(f"seed {seed}", SHORT, TINY, seed, out / str(seed)) for seed in (3, 5)]
        train_missing(candidates, out, engine)
        assert {path.name for path in out.iterdir()} == {".lock", "3", "5"}
        made[name] = candidates
    for here, there in zip(made["here"], made["there"], strict=True):
        assert there.trained
        one, other = AgentFile.load(here.folder), AgentFile.load(there.folder)
        assert one.weights.keys() == other.weights.keys()
        for name, weights in one.weights.items():
            np.testing.assert_array_equal(other.weights[name], weights)
        cards = [json.loads(json.dumps(agent.card)) for agent in (one, other)]
        for card in cards:
            del card["training"]["seconds"]
        assert cards[0] == cards[1]
        curves = [read_curve(candidate.folder / "curve.csv") for candidate in (here, there)]
        np.testing.assert_array_equal(curves[0]["mean_return"], curves[1]["mean_return"])
        assert len({len(list(candidate.folder.rglob("*"))) for candidate in (here, there)}) == 1


def trials_of(arguments):
    import optuna

    storage = optuna.storages.RDBStorage(f"sqlite:///{arguments.out / 'study.db'}")
    try:
        trials = optuna.load_study(study_name=None, storage=storage).trials
        return [(trial.state, trial.params, trial.value, trial.intermediate_values) for trial in trials]
    finally:
        storage.remove_session()
        storage.engine.dispose()


def test_tune(tmp_path, monkeypatch, two):
    """A search on two workers repeats itself; its first two trials are drawn at random, and so those of one worker."""
    monkeypatch.setattr(Hyperparameters, "for_scenario", classmethod(lambda cls, name: TINY))
    found = {}
    for name, workers in (("alone", 1), ("one", 2), ("other", 2)):
        arguments = Tune(trials=3, decisions=256, episodes=4, out=tmp_path / name, override=("episode.steps=24",))
        tune(dataclasses.replace(arguments, work=Work(workers=workers)))
        found[name] = trials_of(arguments)
    assert len(found["one"]) == 3
    assert found["one"] == found["other"]
    assert found["one"] == found["alone"]
    call = (SHORT, TINY, Tune(episodes=4), [])
    ((_, there),) = two.map(tune_module._try, [call])
    assert there == tune_module._try(*call)
    assert there.cost is not None


@pytest.mark.parametrize("name", ["local", "ray"])
def test_a_worker_killed_in_an_evaluation_changes_nothing(name, tmp_path, monkeypatch):
    if name == "ray":
        pytest.importorskip("ray")
    monkeypatch.setenv(PLACE, str(tmp_path))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(sys.path))
    mortal = MortalCircle(spared=os.getpid())
    policies = [mortal, *(find_policy(name, SHORT) for name in ("random", "learned"))]
    expected = evaluate(SHORT, policies, EPISODES, SEED)
    assert marks() == []
    with opened(Work(engine=name, workers=2)) as engine:
        same_scores(evaluate(SHORT, policies, EPISODES, SEED, engine=engine).scores, expected.scores)
    assert marks() == ["killed"]
