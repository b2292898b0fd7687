"""Several seeds at their smallest: an agent per seed, none trained twice, a page and curves that tell them apart."""

import dataclasses
import json
import re
import shlex

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

from agents import AgentFile
from agents.agent_file import CARD
from passloc_env.errors import InputError
from training import candidate as candidate_module
from training.commands import EVALUATION_SEED, Seeds
from training.curve import COLUMNS, read_curve
from training.hyperparameters import HyperparameterError, Hyperparameters
from training.seed_pictures import COLOURS, curves_figure
from training.seeds import seeds

TINY = Hyperparameters(
    environments=8, rollout=16, batch_size=64, epochs=1, network=(8,), overrides={"episode.steps": 40}
)


@pytest.fixture(scope="module", autouse=True)
def small(tmp_path_factory):
    """Small networks and short training; no log folder of SB3's."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SB3_LOGDIR", str(tmp_path_factory.mktemp("logs")))
        patch.setattr(Hyperparameters, "for_scenario", classmethod(lambda cls, name: TINY))
        yield


@pytest.fixture(scope="module")
def arguments(tmp_path_factory):
    return Seeds(seeds=(3, 5), decisions=512, episodes=16, out=tmp_path_factory.mktemp("seeds") / "two words")


@pytest.fixture(scope="module")
def page(arguments):
    return seeds(arguments)


@pytest.fixture
def trained(monkeypatch):
    """The seeds that are trained from here on."""
    found = []
    run = candidate_module.run

    def counting(scenario, parameters, folder, seed, quiet, checkpoint):
        found.append(seed)
        return run(scenario, parameters, folder, seed, quiet, checkpoint=checkpoint)

    monkeypatch.setattr(candidate_module, "run", counting)
    return found


def test_an_agent_per_seed_and_what_is_said_of_them(page, arguments):
    names = {path.name for path in arguments.out.iterdir()}
    pages = {f"BearingsOnly.{ending}" for ending in ("md", "json", "png")}
    assert names == {".lock", "BearingsOnly-3", "BearingsOnly-5"} | pages
    cards = [AgentFile.load(arguments.out / f"BearingsOnly-{seed}").card["training"] for seed in (3, 5)]
    assert [card["seed"] for card in cards] == [3, 5]
    assert [card["decisions"] for card in cards] == [512, 512]


def test_the_spread_on_the_page_is_that_of_the_results(page, arguments):
    data = json.loads((arguments.out / "BearingsOnly.json").read_text(encoding="utf-8"))
    scores = {row["policy"]: row["log_range_bound"]["value"] for row in data["policies"]}
    assert list(scores) == ["circle", "seed 3", "seed 5"]
    spread = abs(scores["seed 3"] - scores["seed 5"])
    gain = scores["circle"] - (scores["seed 3"] + scores["seed 5"]) / 2
    text = page.read_text(encoding="utf-8")
    said = re.search(r"differs by ([\d.]+): (-?\d+) % of what the agents gain on \*circle\*", text)
    assert said is not None
    assert float(said[1]) == pytest.approx(spread, abs=5e-4)
    assert spread > 0.0
    assert int(said[2]) == pytest.approx(100.0 * spread / gain, abs=0.5)
    assert f"16 episodes, seeds {EVALUATION_SEED}–{EVALUATION_SEED + 15}" in text
    assert "(BearingsOnly.png)" in text


def test_the_page_tells_the_command_that_wrote_it(page, arguments):
    text = page.read_text(encoding="utf-8")
    words = shlex.split(text.split("```sh\n")[1].split("\n```")[0])
    assert words[:3] == ["passloc", "seeds", "BearingsOnly"]
    assert words[3:] == [
        *("--seeds", "3", "5"),
        *("--decisions", "512"),
        *("--episodes", "16"),
        *("--out", arguments.out.as_posix()),
    ]


def test_what_is_there_is_not_trained_again(page, arguments, trained):
    before = page.read_text(encoding="utf-8")
    seeds(arguments)
    assert trained == []
    assert page.read_text(encoding="utf-8").partition("| policy")[0] == before.partition("| policy")[0]
    seeds(dataclasses.replace(arguments, seeds=(3, 4)))
    assert trained == [4]


def test_a_card_older_than_a_field_of_its_scenario_means_the_default(page, arguments, trained):
    """Or every new field of a scenario would disown the agents that were trained before it."""
    path = arguments.out / "BearingsOnly-5" / CARD
    card = json.loads(path.read_text(encoding="utf-8"))
    del card["scenario"]["tracker"]["gate"]
    path.write_text(json.dumps(card), encoding="utf-8")
    seeds(arguments)
    assert trained == []


def test_agents_of_other_settings_are_refused_before_anything_is_trained(page, arguments, trained):
    with pytest.raises(InputError, match="BearingsOnly-5 holds an agent trained otherwise"):
        seeds(dataclasses.replace(arguments, seeds=(6, 5), decisions=640))
    assert trained == []


@pytest.mark.parametrize(
    ("changes", "error", "said"),
    [
        ({"seeds": ()}, InputError, "one or more, each of them once"),
        ({"seeds": (1, 2, 1)}, InputError, "one or more, each of them once"),
        ({"seeds": (1, -1)}, InputError, "seed = -1"),
        ({"episodes": 0}, InputError, "episodes = 0"),
        ({"decisions": 0}, HyperparameterError, "decisions = 0"),
        ({"scenario": "BearingOnly"}, InputError, "BearingsOnly"),
    ],
)
def test_bad_input_leaves_nothing_behind(tmp_path, changes, error, said):
    with pytest.raises(error, match=said):
        seeds(dataclasses.replace(Seeds(out=tmp_path / "new"), **changes))
    assert not (tmp_path / "new").exists()


def test_every_run_is_a_line_of_its_own_in_each_picture(page, arguments):
    curves = {name: read_curve(arguments.out / f"BearingsOnly-{name}" / "curve.csv") for name in ("3", "5")}
    figure = curves_figure(curves, "two")
    expected = [
        ("decisions", 1e-6, "mean_return", 1.0),
        ("seconds", 1.0 / 60.0, "mean_return", 1.0),
        ("decisions", 1e-6, "violations", 100.0),
        ("seconds", 1.0 / 60.0, "violations", 100.0),
    ]
    for axes, (across, scale, up, factor) in zip(figure.axes, expected, strict=True):
        assert [line.get_label() for line in axes.lines] == ["3", "5"]
        for line, curve in zip(axes.lines, curves.values(), strict=True):
            np.testing.assert_allclose(line.get_xdata(), scale * curve[across])
            np.testing.assert_allclose(line.get_ydata(), factor * curve[up])
    labels = [axes.get_xlabel() or axes.get_ylabel() for axes in figure.axes]
    assert labels[2:] == ["decisions, millions", "wall time, min"]


def test_more_runs_than_colours_differ_in_their_dashes():
    curve = {name: np.arange(3.0) for name in COLUMNS}
    lines = curves_figure({str(n): curve for n in range(len(COLOURS) + 1)}, "many").axes[0].lines
    assert len({(line.get_color(), line.get_linestyle()) for line in lines}) == len(COLOURS) + 1


@pytest.mark.parametrize("content", [None, "", "a,b\n1,2\n", ",".join(COLUMNS) + "\n1,2,3,4,x\n"])
def test_what_is_no_curve_is_refused(tmp_path, content):
    path = tmp_path / "curve.csv"
    if content is not None:
        path.write_text(content)
    with pytest.raises(InputError, match="not a learning curve"):
        read_curve(path)
