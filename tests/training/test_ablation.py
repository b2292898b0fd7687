"""The ablation at its smallest: an agent per reward, none trained twice, and a page that names them all."""

import dataclasses
import json
import shlex

import pytest

pytest.importorskip("stable_baselines3")

from agents import AgentFile
from agents.agent_file import AgentFileError
from passloc_env import ScenarioError
from passloc_env.errors import InputError
from passloc_env.rewards import DEFAULT_REWARD, KeepOut
from passloc_env.scenario import Scenario
from training import candidate as candidate_module
from training.ablation import REWARDS, ablate
from training.commands import EVALUATION_SEED, Ablate
from training.hyperparameters import Hyperparameters

TINY = Hyperparameters(
    environments=8,
    rollout=16,
    batch_size=64,
    epochs=1,
    network=(8,),
    shield_sigmas=3.0,
    shielded_training=True,
    violation_price=50.0,
    overrides={"episode.steps": 40, "reward": [{"type": "RangeBound"}]},
)
"""With a guard, a price and a reward of its own, which the ablation must leave aside."""
FOLDERS = {
    stem + kept
    for stem in (
        "range-bound",
        "Gram-gain",
        "filter-certainty",
        "tracking-error",
        "range-bound-and-Gram-gain",
        "range-bound-and-Gram-gain-and-tracking-error",
    )
    for kept in ("", "-and-keep-out")
}


@pytest.fixture(scope="module", autouse=True)
def small(tmp_path_factory):
    """Small networks and short training, judged on whole episodes; no log folder of SB3's."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SB3_LOGDIR", str(tmp_path_factory.mktemp("logs")))
        patch.setattr(Hyperparameters, "for_scenario", classmethod(lambda cls, name: TINY))
        yield


@pytest.fixture(scope="module")
def arguments(tmp_path_factory):
    return Ablate(decisions=128, episodes=8, seed=4, out=tmp_path_factory.mktemp("ablation") / "two words")


@pytest.fixture(scope="module")
def page(arguments):
    return ablate(arguments)


@pytest.fixture
def counted(monkeypatch):
    """The rewards that are trained on from here on."""
    trained = []
    run = candidate_module.run

    def counting(scenario, *others, **options):
        trained.append(scenario.reward)
        return run(scenario, *others, **options)

    monkeypatch.setattr(candidate_module, "run", counting)
    return trained


def test_rewards_come_with_and_without_a_keep_out():
    assert DEFAULT_REWARD in REWARDS.values()
    assert len(set(REWARDS.values())) == len(REWARDS) == 12
    kept = {terms[:-1] for terms in REWARDS.values() if terms[-1] == KeepOut()}
    assert kept == {terms for terms in REWARDS.values() if terms[-1] != KeepOut()}


def test_page_lists_every_reward_once_best_first(page, arguments):
    text = page.read_text(encoding="utf-8")
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in text.splitlines() if line.startswith("|")][2:]
    assert sorted(row[0] for row in rows) == sorted(REWARDS)
    bounds = [float(row[1].split()[0]) for row in rows]
    assert bounds == sorted(bounds)
    assert "The default is *range bound + Gram gain + tracking error + keep-out*." in text
    assert f"8 episodes, seeds {EVALUATION_SEED}–{EVALUATION_SEED + 7}" in text


def test_page_tells_the_command_that_wrote_it(page, arguments):
    text = page.read_text(encoding="utf-8")
    words = shlex.split(text.split("```sh\n")[1].split("\n```")[0])
    assert words[:3] == ["passloc", "ablate", "BearingsOnly"]
    options = dict(zip(words[3::2], words[4::2], strict=True))
    assert options == {"--decisions": "128", "--episodes": "8", "--seed": "4", "--out": arguments.out.as_posix()}


def test_agents_learn_from_their_reward_alone_and_nothing_guards_them(page, arguments):
    assert {path.name for path in arguments.out.iterdir()} == FOLDERS | {".lock", "rewards.md", "rewards.json"}
    agents = [AgentFile.load(path) for path in arguments.out.iterdir() if path.is_dir()]
    assert {agent.scenario.reward for agent in agents} == set(REWARDS.values())
    for agent in agents:
        assert agent.card["shield_sigmas"] == 0.0
        assert agent.card["training"]["hyperparameters"]["violation_price"] == 0.0
        assert not agent.card["training"]["hyperparameters"]["shielded_training"]
        assert agent.scenario.episode.steps == 40
        assert agent.card["training"]["seed"] == 4


def test_results_hold_every_reward_on_the_scenario_itself(page, arguments):
    data = json.loads((arguments.out / "rewards.json").read_text(encoding="utf-8"))
    assert [policy["policy"] for policy in data["policies"]] == list(REWARDS)
    assert Scenario.from_dict(data["scenario"]).reward == DEFAULT_REWARD


def test_a_rerun_trains_nothing_and_says_the_same(page, arguments, counted):
    """But for the time that decisions took, which the last column tells."""

    def rows():
        return [line.rsplit("|", 2)[0] for line in page.read_text(encoding="utf-8").splitlines()]

    before = rows()
    ablate(arguments)
    assert counted == []
    assert rows() == before


def test_an_interrupted_ablation_goes_on(arguments, tmp_path, monkeypatch, counted):
    """Cut short in the third training, which had written half of its folder."""
    cut = dataclasses.replace(arguments, out=tmp_path / "cut")
    run = candidate_module.run

    def interrupt(scenario, parameters, folder, seed, quiet, checkpoint):
        if len(counted) == 2:
            (folder / "curve.csv").write_text("half", encoding="utf-8")
            (folder / "stale").write_text("half", encoding="utf-8")
            raise KeyboardInterrupt
        return run(scenario, parameters, folder, seed, quiet, checkpoint=checkpoint)

    with monkeypatch.context() as patch:
        patch.setattr(candidate_module, "run", interrupt)
        with pytest.raises(KeyboardInterrupt):
            ablate(cut)
    assert {path.name for path in cut.out.iterdir()} == {
        "range-bound",
        "range-bound-and-keep-out",
        ".lock",
        "Gram-gain.partial",
    }
    ablate(cut)
    assert counted == list(REWARDS.values())
    assert {path.name for path in cut.out.iterdir()} == FOLDERS | {".lock", "rewards.md", "rewards.json"}
    assert not (cut.out / "Gram-gain" / "stale").exists()


@pytest.mark.parametrize(
    "change", [{"decisions": 256}, {"seed": 5}, {"scenario": "BearingsOnlyFar"}], ids=lambda change: next(iter(change))
)
def test_agents_of_other_settings_are_refused(page, arguments, counted, change):
    before = page.read_text(encoding="utf-8")
    with pytest.raises(InputError, match=r"trained otherwise.*--out") as caught:
        ablate(dataclasses.replace(arguments, **change))
    assert "\n" not in str(caught.value)
    assert counted == []
    assert page.read_text(encoding="utf-8") == before


def test_somebody_elses_folder_is_left_alone(arguments, tmp_path, counted):
    (tmp_path / "Gram-gain").mkdir()
    (tmp_path / "Gram-gain" / "notes.txt").write_text("precious", encoding="utf-8")
    with pytest.raises(AgentFileError, match="not a run folder"):
        ablate(dataclasses.replace(arguments, out=tmp_path))
    assert counted == []
    assert [path.name for path in tmp_path.rglob("*")] == ["Gram-gain", "notes.txt"]


@pytest.mark.parametrize(
    ("change", "error"),
    [
        ({"scenario": "BearingOnly"}, ScenarioError),
        ({"decisions": 0}, InputError),
        ({"episodes": 0}, InputError),
        ({"seed": -1}, InputError),
    ],
    ids=str,
)
def test_refusals_leave_nothing_behind(arguments, tmp_path, change, error):
    with pytest.raises(error) as caught:
        ablate(dataclasses.replace(arguments, out=tmp_path / "new", **change))
    assert "\n" not in str(caught.value)
    assert list(tmp_path.iterdir()) == []
