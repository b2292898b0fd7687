"""A scenario file to begin with: everything that can be set, and what it means; ``passloc new-scenario``."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

from passloc_env.component import Component, Spec, specs
from passloc_env.fields import Part, Parts
from passloc_env.scenario import Scenario
from passloc_env.scenarios import find
from training.arguments import free_path
from training.commands import NewScenario
from training.files import write_whole
from training.progress import console

_HEAD = """\
# A scenario of passloc, begun like {like}. What is left out keeps its default; angles are radians, all else SI.
# Instead of a number a distribution may stand, drawn anew for every episode:
#   {{type: Uniform, low: 1.0, high: 2.0}}, {{type: LogUniform, low: 0.1, high: 9.0}}, {{type: Choice, values: [1, 2]}}
# Then: passloc evaluate {file}; passloc train {file}; passloc replay {file}
"""


def new_scenario(arguments: NewScenario) -> Path:
    """Write the file, which is returned.

    Raises:
        FileExistsError: it is there already; nothing is ever written over.
        ScenarioError: no scenario of the name that it shall be like.
        OSError: a place that cannot be written into.
    """
    path = arguments.file
    like = find(arguments.like)
    if path.exists():
        raise FileExistsError(f"{path} is there already: name another file")
    scenario = like.override({"name": path.stem})
    write_whole(free_path(path), starter(scenario, like.name, str(path)))
    console.print(f"    {path}", highlight=False, soft_wrap=True)
    return path


def starter(scenario: Scenario, like: str, file: str) -> str:
    """YAML from which an equal scenario is built, a comment behind every field."""
    return _HEAD.format(like=like, file=file) + "\n".join(_lines(scenario, "")) + "\n"


def _lines(component: Component, indent: str) -> Iterator[str]:
    yield f"{indent}type: {type(component).__name__}"
    for name, spec in specs(type(component)).items():
        value, comment = getattr(component, name), _comment(spec)
        if isinstance(spec, Part):
            yield f"{indent}{name}:{comment}"
            yield from _lines(value, f"{indent}  ")
        elif isinstance(spec, Parts) and value:
            yield f"{indent}{name}:{comment}"
            for item in value:
                first, *others = _lines(item, f"{indent}  ")
                yield f"{indent}- {first.strip()}"
                yield from others
        else:
            yield f"{indent}{name}: {_flow(value)}{comment}"


def _comment(spec: Spec) -> str:
    return f"  # {spec.doc}, {spec.unit}" if spec.unit else f"  # {spec.doc}"


def _flow(value: Any) -> str:
    """A value in one line of YAML."""
    plain = _plain(value)
    text: str = yaml.safe_dump(plain, default_flow_style=True, width=10_000, sort_keys=False, allow_unicode=True)
    return text.removesuffix("...\n").strip()


def _plain(value: Any) -> Any:
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = {field.name: _plain(getattr(value, field.name)) for field in dataclasses.fields(value)}
        return {"type": type(value).__name__, **fields}
    return [_plain(item) for item in value] if isinstance(value, (tuple, list)) else value
