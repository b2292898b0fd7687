"""Imports run one way, and importing the environment stays cheap."""

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGES = ("passloc_env", "agents", "training")
"""Each may import itself and those before it."""

ROOMS = [
    ["arrays", "errors", "infos", "lazy", "slab", "special", "units", "shadowing"],
    ["angles", "checks", "layout", "linalg", "component", "nuisance", "reading"],
    ["frames", "distributions", "noise", "overrides", "triangular"],
    ["fields"],
    ["motion", "randomisation", "faults"],
    ["platforms"],
    ["sightline", "target"],
    ["sensors", "dynamics"],
    ["sensor_suite"],
    ["tracking"],
    ["metrics", "information"],
    ["observability", "rewards", "belief"],
    ["scenario"],
    ["models", "scenarios"],
    ["compiled", "opening"],
    ["world"],
    ["simulation"],
    ["survey"],
    ["actions", "spaces", "batch", "vector_info"],
    ["crew"],
    ["rendering"],
    ["vector_env"],
    ["env", "sb3"],
    ["registration", "launcher"],
    ["__init__"],
]
"""The rooms of passloc_env from the ground up; each imports from rows above its own in this list, and from itself."""

FLOOR = {room: floor for floor, rooms in enumerate(ROOMS) for room in rooms}
SOURCES = sorted((ROOT / "passloc_env").rglob("*.py"))
HEAVY = ["filterpy", "torch", "stable_baselines3", "pygame", "matplotlib", "scipy", "pymap3d", "stonesoup", "pandas"]


def imported(path):
    """Every module that a file imports anywhere in it; names from a package may be modules too."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}:{node.lineno}: write imports in full"
            found.add(node.module)
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
        elif isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
    return found


def loaded_by_name(path):
    """Literal arguments of import_module and __import__."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Call) and node.args and isinstance(node.args[0], ast.Constant):
            function = getattr(node.func, "attr", getattr(node.func, "id", ""))
            if function in ("import_module", "__import__"):
                yield str(node.args[0].value)


def room_of(path):
    parts = path.relative_to(ROOT / "passloc_env").with_suffix("").parts
    return parts[0]


@pytest.mark.parametrize("package", PACKAGES)
def test_packages_point_one_way(package):
    forbidden = PACKAGES[PACKAGES.index(package) + 1 :]
    files = sorted((ROOT / package).rglob("*.py"))
    assert files
    for path in files:
        tops = {name.split(".")[0] for name in imported(path)}
        assert not tops & set(forbidden), path
        by_name = {name for name in loaded_by_name(path) if name.split(".")[0] in forbidden}
        assert by_name <= ({"training.cli"} if path.name == "launcher.py" else set()), path


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(ROOT)))
def test_rooms_point_down(path):
    room = room_of(path)
    assert room in FLOOR, f"say in ROOMS where {room} belongs"
    used = {name.split(".")[1] for name in imported(path) if name.startswith("passloc_env.")}
    below = {other for other in used if other in FLOOR and other != room}
    too_high = {other for other in below if FLOOR[other] >= FLOOR[room]}
    assert not too_high, f"{room} may not import {sorted(too_high)}"
    assert used <= FLOOR.keys() | {"Scenario"}, f"say in ROOMS where {sorted(used - FLOOR.keys())} belong"


def test_rooms_hold_the_arrows_of_the_design():
    """The list itself: what the world is made of never knows the world, nor its faces."""
    for part in ("motion", "platforms", "sensors", "tracking", "rewards", "belief", "scenario"):
        assert FLOOR[part] < FLOOR["world"] < FLOOR["simulation"] < FLOOR["vector_env"] < FLOOR["env"]
    assert FLOOR["motion"] < FLOOR["platforms"] < FLOOR["sensors"] < FLOOR["tracking"] < FLOOR["observability"]
    assert len(FLOOR) == sum(len(rooms) for rooms in ROOMS)


def test_import_is_cheap():
    program = (
        "import sys, gymnasium; before = set(sys.modules); import passloc_env;"
        "gymnasium.make('passloc/BearingsOnly-v0').reset(seed=0);"
        "print(*sys.modules)"
    )
    answer = subprocess.run(
        [sys.executable, "-W", "error", "-c", program],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=True,
    )
    loaded = {name.split(".")[0] for name in answer.stdout.split()}
    assert {"passloc_env", "gymnasium", "numpy"} <= loaded
    assert not loaded & {*HEAVY, "agents", "training"}
