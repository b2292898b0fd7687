"""The search at its smallest: it goes on where it stopped, however it stopped, and writes what training takes."""

import contextlib
import dataclasses
import io
import sqlite3

import pytest

pytest.importorskip("optuna")
pytest.importorskip("stable_baselines3")

import optuna
from optuna.trial import FixedTrial, TrialState
from rich.console import Console

from passloc_env import ScenarioError
from passloc_env.errors import InputError
from training import files
from training import tune as tune_module
from training.commands import Output, Train, Tune
from training.hyperparameters import Hyperparameters
from training.lock import held
from training.search_space import suggest
from training.study import opened_study
from training.train import train
from training.tune import tune

TINY = Hyperparameters(environments=8, rollout=16, batch_size=32, epochs=4, network=(8,))


@pytest.fixture(autouse=True)
def small(tmp_path, monkeypatch):
    """Small networks, a folder of its own for everything, and no log folder of SB3's."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("SB3_LOGDIR", str(tmp_path / "logs"))
    monkeypatch.setattr(Hyperparameters, "for_scenario", classmethod(lambda cls, name: TINY))


@pytest.fixture
def said(monkeypatch):
    """What is printed."""
    output = io.StringIO()
    monkeypatch.setattr(tune_module, "console", Console(file=output, width=200))
    return output


@pytest.fixture
def arguments(tmp_path):
    return Tune(trials=2, decisions=256, episodes=4, out=tmp_path / "search", override=("episode.steps=40",))


@pytest.fixture
def cheap(monkeypatch):
    """Costs without training: the distance of the learning rate from 1e-3; the trials' learning rates."""
    tried = []

    def cost(scenario, parameters, arguments, watch):
        tried.append(parameters.learning_rate)
        return abs(parameters.learning_rate - 1e-3)

    monkeypatch.setattr(tune_module, "_cost", cost)
    return tried


def trials_in(folder):
    """The trials of a search, as Optuna itself reads them."""
    storage = optuna.storages.RDBStorage(f"sqlite:///{folder / 'study.db'}")
    try:
        return optuna.load_study(study_name=None, storage=storage).trials
    finally:
        storage.remove_session()
        storage.engine.dispose()


def test_a_search_goes_on_and_its_best_can_be_trained(arguments, said):
    best = tune(arguments)
    assert [trial.number for trial in trials_in(arguments.out)] == [0, 1]
    tune(dataclasses.replace(arguments, trials=1))
    trials = trials_in(arguments.out)
    assert [trial.state for trial in trials] == [TrialState.COMPLETE] * 3
    assert {path.name for path in arguments.out.iterdir()} == {".lock", "study.db", "best.yaml"}
    winner = min(trials, key=lambda trial: trial.value)
    parameters = Hyperparameters.load(best)
    assert parameters == suggest(FixedTrial(winner.params), dataclasses.replace(TINY, decisions=256))
    assert best.read_text(encoding="utf-8").startswith(f"# Trial {winner.number} of a search on BearingsOnly:")
    assert f"trial 2: {trials[2].value:.3f}\n" in said.getvalue()
    assert f"best so far is trial {winner.number} with {winner.value:.3f}" in said.getvalue()
    finished = train(Train(hyperparameters=best, override=arguments.override, output=Output(quiet=True)))
    assert finished.agent.card["training"]["hyperparameters"]["learning_rate"] == parameters.learning_rate


def test_trials_repeat_themselves(arguments, tmp_path):
    """Same seeds, same costs, to the last bit."""
    for name in ("one", "other"):
        tune(dataclasses.replace(arguments, out=tmp_path / name))
    one, other = ([trial.value for trial in trials_in(tmp_path / name)] for name in ("one", "other"))
    assert one == other
    assert one[0] != one[1]


def test_the_first_trial_is_what_is_shipped(arguments, cheap):
    tune(arguments)
    assert cheap[0] == TINY.learning_rate
    assert cheap[1] != cheap[0]


@pytest.mark.parametrize("stop", [KeyboardInterrupt, SystemExit], ids=["Ctrl-C", "end of the process"])
def test_an_interrupted_search_comes_to_the_same(arguments, cheap, monkeypatch, tmp_path, stop):
    """Sixteen trials in one go, so that the sampler has left its random phase of ten; then stopped in trials 0 and 12.

    Either stop leaves the trial running in the file, as a killed process does.
    """
    whole = dataclasses.replace(arguments, trials=16)
    tune(whole)
    expected = cheap[:]
    cheap.clear()
    parts = dataclasses.replace(arguments, out=tmp_path / "parts")
    for before, stopped in ((0, True), (12, True), (4, False)):
        if before:
            tune(dataclasses.replace(parts, trials=before))
        if stopped:
            with monkeypatch.context() as patch:
                patch.setattr(tune_module, "_cost", lambda *arguments: (_ for _ in ()).throw(stop()))
                with pytest.raises(stop):
                    tune(dataclasses.replace(parts, trials=1))
            assert trials_in(parts.out)[-1].state is TrialState.RUNNING
    assert cheap == expected
    states = [trial.state for trial in trials_in(parts.out)]
    assert (states.count(TrialState.COMPLETE), states.count(TrialState.FAIL), len(states)) == (16, 2, 18)


def test_seeds_make_different_searches(arguments, cheap, tmp_path):
    for seed in (0, 1):
        tune(dataclasses.replace(arguments, seed=seed, out=tmp_path / str(seed)))
    assert cheap[0] == cheap[2]
    assert cheap[1] != cheap[3]


def test_a_diverging_trial_does_not_end_the_search(arguments, monkeypatch, said):
    def diverge(*arguments):
        raise ValueError("Expected parameter loc to be finite\nbut found nan")

    with monkeypatch.context() as patch:
        patch.setattr(tune_module, "_cost", diverge)
        best = tune(arguments)
    assert not best.exists()
    assert "trial 1: given up: Expected parameter loc to be finite\n" in said.getvalue()
    assert "no trial has been through yet" in said.getvalue()
    assert [trial.state for trial in trials_in(arguments.out)] == [TrialState.PRUNED] * 2


def test_hopeless_trials_are_given_up_half_way(arguments, monkeypatch, said):
    """Five trials go through; of those that come then, one behind all of them is stopped, a better one is not."""
    returns = iter([1.0, 2.0, 3.0, 4.0, 5.0, 0.0, 4.5])
    seen = []

    def run(scenario, parameters, folder, seed, quiet, watch):
        gained = next(returns)
        for decisions in (64, 128, 192, 256):
            seen.append((gained, decisions))
            watch({"mean_return": gained, "decisions": float(decisions)})
        raise ZeroDivisionError

    def cost(scenario, parameters, arguments, watch):
        with pytest.raises(ZeroDivisionError):
            run(scenario, parameters, None, 0, True, watch)
        return 0.0

    monkeypatch.setattr(tune_module, "_cost", cost)
    tune(dataclasses.replace(arguments, trials=7))
    states = [trial.state for trial in trials_in(arguments.out)]
    assert states == [TrialState.COMPLETE] * 5 + [TrialState.PRUNED, TrialState.COMPLETE]
    assert max(decisions for gained, decisions in seen if gained == 0.0) == 128
    assert "trial 5: given up: in the worst quarter after 128 decisions" in said.getvalue()


def test_training_reports_its_curve(arguments):
    """Mean returns come to the study with their signs turned, at the decisions of the curve."""
    tune(dataclasses.replace(arguments, trials=1))
    (trial,) = trials_in(arguments.out)
    assert set(trial.intermediate_values) == {128, 256}


@pytest.mark.parametrize(
    "change",
    [{"decisions": 128}, {"episodes": 5}, {"seed": 1}, {"override": ("episode.steps=44",)}],
    ids=lambda change: next(iter(change)),
)
def test_trials_that_cannot_be_compared_are_not_mixed(arguments, cheap, change):
    tune(arguments)
    before = trials_in(arguments.out)
    named = "scenario" if "override" in change else next(iter(change))
    with pytest.raises(InputError, match=rf"other {named}: .*--out") as caught:
        tune(dataclasses.replace(arguments, **change))
    assert "\n" not in str(caught.value)
    assert trials_in(arguments.out) == before


@pytest.mark.parametrize(
    ("change", "error"),
    [
        ({"scenario": "BearingOnly"}, ScenarioError),
        ({"override": ("episode.stepz=4",)}, ScenarioError),
        ({"trials": 0}, InputError),
        ({"decisions": 0}, InputError),
        ({"episodes": -1}, InputError),
        ({"seed": -1}, InputError),
    ],
    ids=str,
)
def test_refusals_leave_nothing_behind(arguments, tmp_path, change, error):
    with pytest.raises(error) as caught:
        tune(dataclasses.replace(arguments, **change))
    assert "\n" not in str(caught.value)
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_cannot_be_used(arguments, tmp_path):
    (tmp_path / "file").write_text("precious", encoding="utf-8")
    for out in (tmp_path / "file", tmp_path / "file" / "below"):
        with pytest.raises(FileExistsError, match="--out"):
            tune(dataclasses.replace(arguments, out=out))
    assert (tmp_path / "file").read_text(encoding="utf-8") == "precious"


@pytest.mark.parametrize(
    "content", [b"no database " * 100, b"SQLite format 3\x00" + bytes(84)], ids=["text", "damaged"]
)
def test_a_file_that_is_no_study_is_refused(arguments, content):
    arguments.out.mkdir()
    (arguments.out / "study.db").write_bytes(content)
    with pytest.raises(InputError, match=r"study\.db cannot be used") as caught:
        tune(arguments)
    assert "\n" not in str(caught.value)
    assert (arguments.out / "study.db").read_bytes() == content


def test_a_second_search_in_the_same_folder_is_refused(arguments, cheap):
    arguments.out.mkdir()
    with held(arguments.out), pytest.raises(InputError, match=r"search is being written by another process"):
        tune(arguments)
    assert not (arguments.out / "study.db").exists()
    tune(arguments)
    assert len(cheap) == arguments.trials


def test_nothing_is_said_of_a_trials_own_agent(arguments):
    """It lies where nothing lasts."""
    files.forget()
    tune(arguments)
    assert files.saved() == [str(arguments.out / "best.yaml")]


def test_a_study_that_does_something_by_itself_is_refused(arguments, cheap):
    """A trigger of a stranger's runs as often as it likes."""
    tune(arguments)
    with contextlib.closing(sqlite3.connect(arguments.out / "study.db")) as database:
        database.execute("CREATE TRIGGER theirs AFTER INSERT ON trials BEGIN DELETE FROM trials; END")
        database.commit()
    with pytest.raises(InputError, match=r"study\.db cannot be used .* it holds triggers or views"):
        tune(arguments)
    assert len(trials_in(arguments.out)) == arguments.trials


@pytest.mark.parametrize("name", ["with spaces", "per%20cent", "{braces}", "what?#now", "Größe"])
def test_the_study_lies_where_it_is_said_to(tmp_path, name):
    """Nothing in a path may be taken for a part of the database's address."""
    folder = tmp_path / name
    folder.mkdir()
    for _ in range(2):
        with opened_study(folder / "study.db", {"seed": 0}) as study:
            assert study.user_attrs == {"settings": {"seed": 0}}
    assert [path.name for path in folder.iterdir()] == ["study.db"]
    assert [path.name for path in tmp_path.iterdir()] == [name]


def test_by_default_searches_lie_beside_the_runs(arguments, cheap):
    best = tune(dataclasses.replace(arguments, out=None))
    assert best.as_posix() == "runs/tune/BearingsOnly/best.yaml"
    assert best.is_file()
