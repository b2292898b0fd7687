"""Pages about scenarios: complete, true, and committed as the code writes them now."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from PIL import Image

from agents import AgentFileError, default_policies, find_policy, rules_for
from agents.shipped import learned
from passloc_env.component import Component, specs
from passloc_env.distributions import Distribution
from passloc_env.models import observation_names
from passloc_env.rendering.frame import SIZE
from passloc_env.scenario import Scenario
from passloc_env.scenarios import SCENARIOS, environment_id
from passloc_env.spaces import observation_space
from training.scenario_films import FRAMES, write_film
from training.scenario_pages import film_name, index_page, page, pilot, write_pages

COMMITTED = Path(__file__).parents[2] / "docs" / "scenarios"
STALE = "is stale: run `passloc list --pages docs/scenarios`"


@pytest.fixture(params=SCENARIOS.values(), ids=list(SCENARIOS))
def scenario(request: pytest.FixtureRequest) -> Scenario:
    found: Scenario = request.param
    return found


def section(text: str, heading: str) -> str:
    """What stands under a heading."""
    return text.split(f"\n## {heading}\n", 1)[1].split("\n## ", 1)[0]


def test_committed_pages_are_what_the_code_writes(scenario: Scenario) -> None:
    path = COMMITTED / f"{scenario.name}.md"
    assert path.read_text(encoding="utf-8") == page(scenario), f"{path.name} {STALE}"


def test_the_committed_index_is_what_the_code_writes() -> None:
    assert (COMMITTED / "index.md").read_text(encoding="utf-8") == index_page(), f"index.md {STALE}"


def test_every_scenario_has_a_page_and_nothing_else_has() -> None:
    pages, films = {f"{name}.md" for name in SCENARIOS}, {film_name(scenario) for scenario in SCENARIOS.values()}
    assert {path.name for path in COMMITTED.iterdir()} == {"index.md"} | pages | films


def test_the_film_is_there_and_says_who_flies(scenario: Scenario) -> None:
    """A moving picture of at most 250 kB, of the shipped agent wherever one fits the scenario."""
    film = COMMITTED / film_name(scenario)
    assert film.stat().st_size <= 250_000
    with Image.open(film) as image:
        assert 1 < image.n_frames <= 40
    shown = section(page(scenario), "Watch it")
    assert f"]({film.name})" in shown
    assert f"passloc replay {scenario.name} --policy {pilot(scenario)} " in shown
    assert find_policy(pilot(scenario), scenario).act
    try:
        learned(scenario)
    except AgentFileError:
        assert pilot(scenario) in rules_for(scenario)
    else:
        assert pilot(scenario) == "learned"


def test_a_film_is_written_where_asked(tmp_path: Path) -> None:
    """A few pictures of the whole episode, the end held, two policies side by side."""
    scenario = SCENARIOS["CrossFix"]
    path = tmp_path / "film.gif"
    write_film(path, scenario, [find_policy(name, scenario) for name in ("circle", "straight")])
    decisions = scenario.episode.steps // scenario.episode.decision_every
    assert decisions < FRAMES
    with Image.open(path) as image:
        assert image.size == (2 * SIZE, SIZE)
        assert 2 <= image.n_frames <= 2 + decisions


def test_every_observation_and_reward_is_named(scenario: Scenario) -> None:
    text = page(scenario)
    features = [line for line in section(text, "Observation").splitlines() if line.startswith("|")][2:]
    assert features == [f"| {row} | {name} |" for row, name in enumerate(observation_names(scenario))]
    assert observation_space(scenario).shape == (len(features),)
    assert f"`Box(-10, 10, ({len(features)},), float32)`" in section(text, "Observation")
    rows = [line for line in section(text, "Rewards").splitlines() if line.startswith("|")][2:]
    assert rows == [f"| {term.name} | {term.weight:g} |" for term in scenario.reward]


def test_actions_ends_and_rules(scenario: Scenario) -> None:
    text, episode = page(scenario), scenario.episode
    assert text.startswith(f"# {environment_id(scenario.name)}\n\n")
    actions = section(text, "Actions")
    assert f"`Box(-1, 1, ({scenario.action_size},), float32)`" in actions
    assert f"one decision each {episode.interval:g} s" in actions
    for index in range(len(scenario.platforms)):
        assert (f"platform {index}: " in actions) == (scenario.platforms[index].controls > 0)
    ends = section(text, "Episode end")
    assert f"after {episode.steps} measurements ({episode.duration:g} s)" in ends
    keep_out = f"entering {episode.min_range:g} m of the emitter"
    assert (keep_out in ends) == (episode.min_range > 0.0)
    rules, board = section(text, "Rules that fly it").strip().split("\n\n")
    assert f"(../leaderboard/index.md#{scenario.name.lower()})" in board
    assert rules == ", ".join(f"`{name}`" for name in default_policies(scenario))


def leaves(component: Component, where: str = "") -> Iterator[str]:
    """The dotted name of everything that can be overridden in a component, down to quantities."""
    for name in specs(type(component)):
        value = getattr(component, name)
        items = {f"{name}.{i}": item for i, item in enumerate(value)} if isinstance(value, tuple) else {name: value}
        parts = {key: item for key, item in items.items() if isinstance(item, Component)}
        parts = {key: item for key, item in parts.items() if not isinstance(item, Distribution)}
        if not parts:
            yield f"{where}{name}"
        for key, part in parts.items():
            yield from leaves(part, f"{where}{key}.")


def test_every_number_is_there(scenario: Scenario) -> None:
    """By dotted name, as overrides take it, each with what it means."""
    lines = section(page(scenario), "Everything it is made of").splitlines()
    rows = [line.strip("| ").split(" | ") for line in lines if line.startswith("| ")][2:]
    shown = [row[0] for row in rows]
    assert [name for name in shown if not name.startswith("**")] == list(leaves(scenario))
    assert len(shown) == len(set(shown))
    for row in rows:
        assert len(row) == 4
        assert row[1]
        assert row[3]


def test_values_by_hand() -> None:
    """Numbers, distributions, lists and switches as they are read."""
    text = page(SCENARIOS["DualSatellite"])
    for row in (
        "| target.start.latitude | Uniform(low=0.418879, high=0.541052) | rad | geodetic latitude |",
        "| target.start.height | 10000 | m | height above the ellipsoid |",
        "| **platforms.1** | **CircularOrbit** |  | the observers |",
        "| sensors.4.sigma | 5e-09 | s | standard deviation |",
        "| sensors.0.lever_arm | – | m | where on the platform, along its body axes |",
        "| episode.early_end | True |  | whether entering min_range or losing the track ends the episode |",
    ):
        assert row in text.splitlines()
    assert "platform 1: body rates (roll, pitch, yaw)" in text
    assert "nothing but a lost track" in text
    assert "platform 0: heading relative to the line of sight" in page(SCENARIOS["BearingsOnly"])
    turning = SCENARIOS["BearingDoppler"]
    assert "Uniform(low=0.00523599, high=0.0349066, either_sign=True)" in page(turning)


def test_stories_are_the_files_own(scenario: Scenario) -> None:
    """The first paragraphs tell of the family, the next of the scenario itself; the index repeats the latter."""
    text = page(scenario)
    story = text.split("\n## ", 1)[0].splitlines()
    last = [line for line in story if line][-1]
    row = f"| [`{environment_id(scenario.name)}`]({scenario.name}.md) | {last} | "
    assert any(line.startswith(row) for line in index_page().splitlines())
    assert len(story) >= 5
    assert "Args:" not in text


def test_a_scenario_that_no_file_describes() -> None:
    with pytest.raises(LookupError, match="Mine"):
        page(Scenario(name="Mine"))


def test_pages_are_written_where_asked(tmp_path: Path) -> None:
    written = write_pages(tmp_path / "new" / "pages")
    assert {path.name for path in written} == {path.name for path in COMMITTED.glob("*.md")}
    for path in written:
        assert path.read_text(encoding="utf-8") == (COMMITTED / path.name).read_text(encoding="utf-8")
    assert written == write_pages(tmp_path / "new" / "pages")
