"""What the docstrings say is so."""

import doctest
import importlib
import inspect
import pkgutil
import re
import textwrap

import pytest

import passloc_env
from passloc_env import SCENARIOS, LocalisationEnv, observation_names
from passloc_env.rewards import DEFAULT_REWARD

PAGE = inspect.getdoc(LocalisationEnv)
MODULES = ["passloc_env", *(module.name for module in pkgutil.walk_packages(passloc_env.__path__, "passloc_env."))]
ROW = re.compile(r"^\| (\d+)(?:–(\d+))? \| (.+?) \|", re.MULTILINE)
BLOCK = re.compile(r"^ *```python\n(.*?)^ *```$", re.MULTILINE | re.DOTALL)
CALLED = {
    "ln of the believed range": "ln range",
    "own velocity": "own velocity",
    "believed emitter velocity": "emitter velocity",
    "ln of the standard deviations": "ln sigma of",
    "correlations": "correlation of",
    "time left": "time left",
    "last action": "last action",
}
"""How the names of features begin, by how their row of the table begins."""


def test_observation_table():
    names = observation_names(SCENARIOS["BearingsOnly"])
    rows = [(int(first), int(last or first), text) for first, last, text in ROW.findall(PAGE)]
    assert len(rows) == len(CALLED)
    expected = 0
    for first, last, text in rows:
        assert first == expected, text
        beginning = next(name for words, name in CALLED.items() if text.startswith(words))
        assert all(name.startswith(beginning) for name in names[first : last + 1]), text
        expected = last + 1
    assert expected == len(names) == LocalisationEnv().observation_space.shape[0]


def test_number_of_features():
    (number,) = re.findall(r"\bf = (\d+)", PAGE)
    assert int(number) == len(observation_names(SCENARIOS["BearingsOnly"]))


def test_reward_weights():
    (rewards,) = re.findall(r"## Rewards\n(.*?)\n## ", PAGE, re.DOTALL)
    quoted = {name: float(weight) for name, weight in re.findall(r"``(\w+)``\s+\(([\d.]+)\)", rewards)}
    assert quoted == {term.name: term.weight for term in DEFAULT_REWARD}
    assert quoted == {"range_bound": 1.0, "gram_gain": 0.05, "tracking_error": 0.1, "keep_out": 1.0}


def test_action_and_observation_boxes():
    env = LocalisationEnv()
    assert re.findall(r"``(Box\(.*?\), float32\))``", PAGE) == [
        "Box(-1, 1, (a,), float32)",
        "Box(-10, 10, (f,), float32)",
    ]
    assert (env.action_space.low, env.action_space.high, env.action_space.shape) == (-1, 1, (1,))
    assert set(env.observation_space.low) | set(env.observation_space.high) == {-10, 10}


def test_diagnostics_are_named():
    """Every key of the diagnostics is spoken of."""
    for kind in (LocalisationEnv, passloc_env.LocalisationVectorEnv):
        page = " ".join(inspect.getdoc(kind).split())
        _, info = LocalisationEnv(diagnostics=True).reset(seed=0)
        for key in info.keys() - {"reward_terms", "violated"}:
            words = {"nees": "NEES", "relative_range_error": "relative range error"}.get(key, key)
            assert words in page, f"{kind.__name__} is silent about {key}"


@pytest.mark.parametrize("name", SCENARIOS)
def test_every_feature_has_a_name_of_its_own(name):
    env = LocalisationEnv(name)
    names = observation_names(env.scenario)
    assert len(set(names)) == len(names) == env.observation_space.shape[0]


def test_default_of_each_argument():
    signature = inspect.signature(LocalisationEnv)
    assert signature.parameters["scenario"].default == "BearingsOnly"
    assert inspect.signature(passloc_env.LocalisationVectorEnv).parameters["num_envs"].default == 1
    for argument in signature.parameters:
        assert f"``{argument}``" in PAGE


@pytest.mark.parametrize("name", MODULES)
def test_docstrings_run(name):
    module = importlib.import_module(name)
    assert module.__doc__, f"{name} has no docstring"
    assert doctest.testmod(module).failed == 0
    for test in doctest.DocTestFinder(exclude_empty=False).find(module):
        for block in BLOCK.findall(test.docstring):
            exec(compile(textwrap.dedent(block), test.name, "exec"), {})


def test_page_has_an_example_that_runs():
    (block,) = BLOCK.findall(PAGE)
    scope = {}
    exec(compile(block, "LocalisationEnv", "exec"), scope)
    assert isinstance(scope["env"].unwrapped, LocalisationEnv)
    assert scope["env"].unwrapped.scenario.episode.decision_every == 1
