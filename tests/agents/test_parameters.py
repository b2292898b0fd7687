"""What rules and planners can be told: declared once, and true of what they are by default."""

import inspect
import math
from typing import Annotated, Any

import pytest

from agents import PLANNER_NAMES, RULE_NAMES, PolicyError, find_policy
from agents.catalogue import meaning_of, parameters_of
from agents.parameters import Number, Word, declared
from passloc_env import SCENARIOS

SCENARIO = SCENARIOS["BearingsOnly"]
TOLD = [(name, parameter) for name in (*RULE_NAMES, *PLANNER_NAMES) for parameter in parameters_of(name)]


def inner(scenario, ratio: Annotated[float, Number("a ratio", "m/s", most=2.0)] = 0.5): ...


def outer(
    scenario, word: Annotated[str, Word("a word", ("one", "other"))] = "one", **others: Annotated[Any, inner]
): ...


def test_what_is_handed_on_is_declared_where_it_is_taken():
    found = declared(outer)
    assert list(found) == ["word", "ratio"]
    assert [told.default for told in found.values()] == ["one", 0.5]
    assert [told.shown for told in found.values()] == ["one", "0.5"]
    assert found["ratio"].kind.unit == "m/s"


@pytest.mark.parametrize(
    ("number", "allowed", "good", "bad"),
    [
        (Number("n", most=2.0), "a number from 0 to 2", ["0", "2", "1e0"], ["-0.1", "2.1", "nan", "inf"]),
        (Number("n"), "a finite number of at least 0", ["0", "1e9"], ["-1", "inf", "nan"]),
        (Number("n", above=True), "a finite number above 0", ["1e-9"], ["0", "inf", "-inf"]),
        (Number("n", endless=True), "a number of at least 0", ["0", "inf"], ["-1", "nan", "-inf"]),
        (Number("n", least=1, whole=True), "a whole number of at least 1", ["1", "2.0"], ["0", "1.5", "inf", "nan"]),
    ],
)
def test_numbers_are_what_the_words_allow(number, allowed, good, bad):
    assert number.allowed == allowed
    for text in good:
        assert number.read("n", text) == float(text)
    for text in bad:
        with pytest.raises(ValueError, match=f"^n must be {allowed}$"):
            number.read("n", text)
    with pytest.raises(ValueError, match="'n=x' must be name=number"):
        number.read("n", "x")


def test_whole_numbers_are_whole():
    assert isinstance(Number("n", whole=True).read("n", "3"), int)


@pytest.mark.parametrize(("name", "parameter"), TOLD)
def test_a_default_is_allowed_and_is_what_flies(name, parameter):
    """Told its default a policy is the same to the last field; where that depends on the scenario, words say how."""
    told = parameters_of(name)[parameter]
    assert told.kind.meaning
    assert (told.default is None) == bool(told.kind.by_default)
    if told.default is not None:
        assert find_policy(f"{name}:{parameter}={told.shown}", SCENARIO) == find_policy(name, SCENARIO)


@pytest.mark.parametrize(("name", "parameter"), TOLD)
def test_what_is_not_allowed_is_refused_in_the_words_of_the_page(name, parameter):
    told = parameters_of(name)[parameter]
    wrong = "nonsense" if isinstance(told.kind, Word) else f"{told.kind.least - 1.0:g}"
    with pytest.raises(PolicyError) as caught:
        find_policy(f"{name}:{parameter}={wrong}", SCENARIO)
    assert str(caught.value).endswith(f"{parameter} must be {told.kind.allowed}")


def test_defaults_that_depend_on_the_scenario_are_what_the_words_say():
    scenario = SCENARIOS["CrossFix"]
    interval, duration = scenario.episode.interval, scenario.episode.duration
    assert parameters_of("zigzag")["leg"].shown == "a sixth of the episode, in whole decisions"
    assert find_policy("zigzag", scenario).leg == math.floor(duration / 6.0 / interval + 0.5) * interval
    assert parameters_of("horizon")["seconds"].shown == "12 decisions"
    assert find_policy("horizon", scenario).seconds == 12 * interval
    assert parameters_of("horizon")["generations"].shown == "one per control"
    assert find_policy("horizon", scenario).generations == scenario.action_size


@pytest.mark.parametrize("name", [*RULE_NAMES, *PLANNER_NAMES])
def test_everybody_has_a_line(name):
    line = meaning_of(name)
    assert line.endswith(".")
    assert line == inspect.cleandoc(line)
