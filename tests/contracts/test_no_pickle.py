"""Nothing that a file holds is ever run: no pickles, no evaluation of text, anywhere in the sources."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SOURCES = sorted(path for package in ("passloc_env", "agents", "training") for path in (ROOT / package).rglob("*.py"))

MODULES = {"cloudpickle", "dill", "joblib", "marshal", "pickle", "runpy", "shelve", "code", "codeop"}
BUILTINS = {"eval", "exec", "__import__"}
NEVER = {
    *("pandas.read_pickle", "numpy.core.multiarray._reconstruct", "torch.jit.load", "torch.hub.load", "os.system"),
    *("yaml.unsafe_load", "yaml.unsafe_load_all", "yaml.full_load", "yaml.full_load_all", "yaml.load_all"),
    *("yaml.Loader", "yaml.UnsafeLoader", "yaml.FullLoader", "yaml.safe_load", "json.load"),
}
ONLY_SO = {
    "torch.load": "weights_only=True",
    "numpy.load": "allow_pickle=False",
    "numpy.lib.format.read_array": "allow_pickle=False",
    "yaml.load": "_PlainLoader",
}
"""Functions that could run what they read, and the words in every call that keep them from it."""

BETWEEN_OWN_PROCESSES = {"passloc_env/crew.py", "passloc_env/slab.py", "training/engines/local.py"}
"""Where several processes of ours talk to each other, through pipes that they have made; no file is involved."""

READ_PLAINLY = {"passloc_env/reading.py"}
"""Where files of strangers become data; ``json.loads`` elsewhere reads only what the program itself has written."""

OWN_TEXT = {"training/tune.py", "training/learner.py", "training/candidate.py", "training/leaderboard/store.py"}
OWN_TEXT |= {"training/report/page.py", "training/results.py", "training/checkpoint.py"}
"""A checkpoint is as long as its run, and its digest is looked at first."""


def dotted(node):
    """The name of a function as it is called, e.g. ``np.lib.format.read_array``; empty when it has none."""
    if isinstance(node, ast.Attribute):
        return f"{dotted(node.value)}.{node.attr}"
    return node.id if isinstance(node, ast.Name) else ""


def offences(source, name):
    """Each use of what could run a file, as ``line: what``."""
    tree, aliases = ast.parse(source), {}
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for each in node.names:
                aliases[each.asname or each.name.split(".")[0]] = each.name if each.asname else each.name.split(".")[0]
        elif isinstance(node, ast.ImportFrom):
            aliases |= {each.asname or each.name: f"{node.module}.{each.name}" for each in node.names}
    for node in ast.walk(tree):
        if isinstance(node, (ast.Import, ast.ImportFrom)):
            modules = [each.name for each in node.names] if isinstance(node, ast.Import) else [node.module]
            for module in modules:
                if module.split(".")[0] in MODULES and name not in BETWEEN_OWN_PROCESSES:
                    yield f"{node.lineno}: {module}"
        if not isinstance(node, ast.Call):
            continue
        head, _, rest = dotted(node.func).partition(".")
        called = ".".join(filter(None, (aliases.get(head, head), rest)))
        if called in NEVER | BUILTINS or called.endswith((".load_from_pickle", "PPO.load", "VecNormalize.load")):
            yield f"{node.lineno}: {called}"
        if called == "json.loads" and name not in READ_PLAINLY | OWN_TEXT:
            yield f"{node.lineno}: {called}"
        if called in ONLY_SO and ONLY_SO[called] not in ast.unparse(node):
            yield f"{node.lineno}: {called} without {ONLY_SO[called]}"


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_no_source_runs_what_it_reads(path):
    assert list(offences(path.read_text(encoding="utf-8"), path.relative_to(ROOT).as_posix())) == []


@pytest.mark.parametrize(
    "line",
    [
        "import pickle",
        "from joblib import load",
        "import numpy as np; np.load(path)",
        "import numpy as np; np.load(path, allow_pickle=True)",
        "from numpy import load; load(path)",
        "from torch import load as read; read(path)",
        "import torch; torch.load(path, weights_only=False)",
        "import yaml; yaml.load(text, yaml.Loader)",
        "import yaml; yaml.unsafe_load(text)",
        "from stable_baselines3 import PPO; PPO.load(path)",
        "eval(text)",
        "import json; json.loads(text)",
    ],
)
def test_the_search_itself_finds(line):
    assert list(offences(line, "training/new.py"))
