"""Watching policies fly the same episode side by side; ``passloc replay``."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from gymnasium.vector import AutoresetMode

from agents import Policy, find_policy
from passloc_env.errors import InputError
from passloc_env.rendering.frame import SIZE, draw_frame
from passloc_env.rendering.map_panel import extent
from passloc_env.rendering.record import Instant, Recorder
from passloc_env.rendering.renderer import FRAMES_PER_SECOND
from passloc_env.rendering.window import Window
from passloc_env.scenario import Scenario
from passloc_env.scenarios import find
from passloc_env.vector_env import LocalisationVectorEnv
from training.arguments import check_seed, free_path, parse_overrides
from training.commands import Replay
from training.episodes import decide
from training.progress import console, progress_bar

_HELD = 15
"""Frames for which the end is shown."""


def replay(arguments: Replay) -> list[Path]:
    """Fly the episode, and show it in a window unless files are asked for; the files.

    Raises:
        InputError: an unknown scenario or policy, a negative seed, or a file that does not end as it should.
        OSError: a place that cannot be written into; told before anything is flown.
        RenderError: no file is asked for, and there is no display.
    """
    check_seed(arguments.seed)
    scenario = find(arguments.scenario).override(parse_overrides(arguments.override))
    policies = [find_policy(name.strip(), scenario) for name in arguments.policy.split(",")]
    wanted = {ending: getattr(arguments, ending) for ending in ("gif", "mp4", "html")}
    files: dict[str, Path] = {ending: path for ending, path in wanted.items() if path is not None}
    for ending, path in files.items():
        if path.suffix.lower() != f".{ending}":
            raise InputError(f"{ending} = {str(path)!r} is not possible: must end in .{ending}")
        free_path(path)
    if not files:
        title, width = f"{scenario.name}, seed {arguments.seed}", SIZE * len(policies)
        window = Window(title, width, SIZE, "name a file with --gif or --mp4")
        _show(window, _recorded(scenario, policies, arguments.seed))
        return []
    for path in _write(files, scenario, policies, arguments.seed):
        console.print(f"    {path}", highlight=False, soft_wrap=True)
    return list(files.values())


def _write(files: dict[str, Path], scenario: Scenario, policies: Sequence[Policy], seed: int) -> Iterator[Path]:
    """Fly once, and write all that was asked for; each file once it is whole."""
    films = {ending: path for ending, path in files.items() if ending != "html"}
    # What is not installed is told before anything is flown.
    if "html" in files:
        from training.report.episode_page import write_episode
    if films:
        from training.film import write_gif, write_mp4
    recordings = _recorded(scenario, policies, seed)
    if "html" in files:
        write_episode(files["html"], scenario, recordings, seed)
        yield files["html"]
    if films:
        frames = _drawn(recordings)
        frames += [frames[-1]] * _HELD
        for ending, path in films.items():
            {"gif": write_gif, "mp4": write_mp4}[ending](path, frames, FRAMES_PER_SECOND)
            yield path


@dataclass(frozen=True)
class Recording:
    """An episode flown by a policy.

    Attributes:
        scenario: as it was flown, with the policy's overrides.
        name: of the policy.
        instants: the first look, and one per sensor step until the end.
        decisions: how many instants there were at the first look and after each decision.
    """

    scenario: Scenario
    name: str
    instants: list[Instant]
    decisions: list[int]

    def upto(self, decision: int) -> list[Instant]:
        """What had happened when a decision had been flown; who has ended waits."""
        return self.instants[: self.decisions[min(decision, len(self.decisions) - 1)]]


def record(scenario: Scenario, policy: Policy, seed: int) -> Recording:
    """Fly an episode from its first look to its end."""
    flown = scenario.override(dict(policy.overrides))
    env = LocalisationVectorEnv(1, flown, autoreset_mode=AutoresetMode.DISABLED)
    recorder = Recorder(env.batch.tiles[0], 0)
    observation, _ = env.reset(seed=seed)
    rng, ended = np.random.default_rng(seed), False
    decisions = [len(recorder.look())]
    while not ended:
        observation, _, terminated, truncated, _ = env.step(decide(policy, env, observation, rng))
        ended = bool(terminated[0] or truncated[0])
        decisions.append(len(recorder.look()))
    return Recording(flown, policy.name, recorder.instants, decisions)


def side_by_side(recordings: Sequence[Recording]) -> Iterator[np.ndarray]:
    """Pictures ``(height, Σ width, 3)`` of the first look and after each decision, all on one scale."""
    seen = [extent(each.instants, each.scenario.episode.min_range) for each in recordings]
    shown = np.concatenate(seen)
    for decision in range(max(len(each.decisions) for each in recordings)):
        canvases = [draw_frame(each.scenario, each.upto(decision), each.name, shown) for each in recordings]
        yield np.concatenate([canvas.pixels() for canvas in canvases], axis=1)


def _recorded(scenario: Scenario, policies: Sequence[Policy], seed: int) -> list[Recording]:
    with progress_bar("flights") as bar:
        task = bar.add_task(f"flying {scenario.name}", total=len(policies))
        recordings = []
        for policy in policies:
            recordings.append(record(scenario, policy, seed))
            bar.advance(task)
    return recordings


def _drawn(recordings: Sequence[Recording]) -> list[np.ndarray]:
    frames = []
    with progress_bar("pictures") as bar:
        task = bar.add_task("drawing", total=max(len(each.decisions) for each in recordings))
        for frame in side_by_side(recordings):
            frames.append(frame)
            bar.advance(task)
    return frames


def _show(window: Window, recordings: Sequence[Recording]) -> None:
    for frame in side_by_side(recordings):
        if not window.show(frame, FRAMES_PER_SECOND):
            break
    window.wait()
