"""Nothing that a file holds is ever run: the sources refer to no known way of opening a pickle or evaluating text.

The search reads names, so it keeps those who write the sources from mistakes; it does not stop who means to hide.
"""

import ast
import builtins
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
SOURCES = sorted(path for package in ("passloc_env", "agents", "training") for path in (ROOT / package).rglob("*.py"))

NEVER = {
    *("_pickle", "cloudpickle", "dill", "joblib", "jsonpickle", "marshal", "pickle", "pickle5", "shelve"),
    *("multiprocessing.connection.Client", "multiprocessing.connection.Listener"),
    *("multiprocessing.managers", "multiprocessing.reduction"),
    *("builtins", "code", "codeop", "imp", "pty", "runpy", "subprocess", "sys.modules"),
    *("__builtins__", "__import__", "compile", "eval", "exec"),
    *("importlib.__import__", "importlib.abc", "importlib.import_module", "importlib.machinery", "importlib.util"),
    *("ctypes.CDLL", "ctypes.PyDLL", "ctypes.cdll", "ctypes.pydll", "ctypes.pythonapi"),
    *("os.popen", "os.posix_spawn", "os.posix_spawnp", "os.startfile", "os.system"),
    *(
        f"os.{kind}{ending}"
        for kind in ("exec", "spawn")
        for ending in ("l", "le", "lp", "lpe", "v", "ve", "vp", "vpe")
    ),
    *("torch.hub", "torch.jit.load", "torch.package", "torch.serialization"),
    *(f"yaml.{name}" for name in ("Loader", "FullLoader", "UnsafeLoader", "safe_load", "safe_load_all", "load_all")),
    *("json.JSONDecoder", "json.decoder", "json.load"),
}
"""Modules, and what is in them, that could run what they read, or read it carelessly."""

NEVER_BY_LAST_NAME = {
    *("CLoader", "CFullLoader", "CUnsafeLoader", "full_load", "full_load_all", "unsafe_load", "unsafe_load_all"),
    *("ForkingPickler", "NpzFile", "Unpickler", "_reconstruct", "load_from_pickle", "read_pickle"),
    *("__builtins__", "__globals__", "__subclasses__"),
}
"""What would be no better wherever it came from."""

NEVER_LOADED = ("A2C.load", "BaseAlgorithm.load", "PPO.load", "VecNormalize.load")

KEYWORDS = {"allow_pickle": False, "weights_only": True, "shell": False}
"""Arguments of any call that have to be these constants."""

ONLY_SO = {"torch.load": "weights_only", "numpy.load": "allow_pickle", "numpy.lib.format.read_array": "allow_pickle"}
"""Functions that could run what they read, and the argument in every call that keeps them from it."""

PROGRAM_PARTS = "importlib.import_module"
LEGITIMATE = {
    # Several processes of ours talk to each other, through pipes that they have made; no file is involved.
    "passloc_env/crew.py": {"pickle"},
    "passloc_env/slab.py": {"pickle"},
    "training/engines/local.py": {"pickle"},
    # Parts of the program are imported when they are needed, by names that the program holds.
    "passloc_env/launcher.py": {PROGRAM_PARTS},
    "training/cli.py": {PROGRAM_PARTS},
    "training/papers/catalogue.py": {PROGRAM_PARTS},
    "training/scenario_words.py": {PROGRAM_PARTS},
    "passloc_env/registration.py": {"importlib.abc", "importlib.machinery", "sys.modules"},
    "passloc_env/shadowing.py": {"importlib.machinery.ModuleSpec", "importlib.util"},
    "passloc_env/compiled/graph.py": {"numpy.*"},
    # The compiler of this machine is given a source that is part of the program.
    "training/benchmark/limit/__init__.py": {"subprocess", "ctypes.CDLL"},
    "training/reliability/record.py": {"ctypes.CDLL"},
}
"""What a file may refer to all the same; ``module.*`` is what has a name that is not written there."""

READ_PLAINLY = {"passloc_env/reading.py"}
"""Where files of strangers become data; ``json.loads`` elsewhere reads only what the program itself has written."""

OWN_TEXT = {"training/tune.py", "training/learner.py", "training/candidate.py", "training/leaderboard/store.py"}
OWN_TEXT |= {"training/report/page.py", "training/results.py", "training/checkpoint.py"}
"""A checkpoint is as long as its run, and its digest is looked at first."""


def constant(node):
    """A text that is written there; ``*`` for any other."""
    return node.value if isinstance(node, ast.Constant) else "*"


def dotted(node):
    """What a node refers to, e.g. ``np.lib.format.read_array``, or ``.shape`` of something that has no name."""
    if isinstance(node, ast.Attribute):
        return f"{dotted(node.value)}.{node.attr}"
    if isinstance(node, ast.Call) and dotted(node.func) == "getattr" and len(node.args) > 1:
        return f"{dotted(node.args[0])}.{constant(node.args[1])}"
    return node.id if isinstance(node, ast.Name) else ""


class Names:
    """What the names in a source stand for, as far as its imports and plain assignments tell."""

    def __init__(self, tree):
        self.aliases, self.imported = {}, []
        for node in ast.walk(tree):
            if isinstance(node, ast.Import):
                self.imported += [(node.lineno, each.name) for each in node.names]
                for each in node.names:
                    root = each.name.split(".")[0]
                    self.aliases[each.asname or root] = each.name if each.asname else root
            elif isinstance(node, ast.ImportFrom):
                found = {each.asname or each.name: f"{node.module}.{each.name}" for each in node.names}
                self.imported += [(node.lineno, name) for name in found.values()]
                self.aliases |= found
        for node in ast.walk(tree):
            if isinstance(node, ast.Assign) and dotted(node.value).partition(".")[0] in self.aliases:
                named = [target.id for target in node.targets if isinstance(target, ast.Name)]
                self.aliases |= dict.fromkeys(named, self.full(node.value))

    def full(self, node):
        """What a node refers to, by the name of its module; what is neither imported nor built in begins with a dot."""
        head, dot, rest = dotted(node).partition(".")
        return self.aliases.get(head, head if hasattr(builtins, head) else f".{head}") + dot + rest

    def references(self, tree):
        """All that is imported or referred to, as (line, full name, node)."""
        yield from ((line, name, None) for line, name in self.imported)
        for node in ast.walk(tree):
            if isinstance(node, (ast.Name, ast.Attribute, ast.Call)):
                yield node.lineno, self.full(node), node

    def is_module_of_others(self, name):
        return name in {value for value in self.aliases.values() if value.islower()}


def within(name, wholes):
    """Whether a name is one of these, or in one of them."""
    return any(name == whole or name.startswith(f"{whole}.") for whole in wholes)


def is_constant(call, keyword):
    """Whether a call names an argument, and gives it the one value that it may have."""
    given = [each.value for each in call.keywords if each.arg == keyword]
    return [isinstance(each, ast.Constant) and each.value is KEYWORDS[keyword] for each in given] == [True]


def is_plain_yaml(call):
    loader = [*call.args[1:], *(each.value for each in call.keywords)]
    return [dotted(each) for each in loader] == ["_PlainLoader"]


def offences(source, name):
    """Each use of what could run a file, as ``line: what``."""
    tree = ast.parse(source)
    names, legitimate = Names(tree), LEGITIMATE.get(name, set())
    calls = {id(node.func): node for node in ast.walk(tree) if isinstance(node, ast.Call)}
    for call in calls.values():
        for keyword in call.keywords:
            if keyword.arg in KEYWORDS and not is_constant(call, keyword.arg):
                yield f"{call.lineno}: {keyword.arg} is not always {KEYWORDS[keyword.arg]}"
    for line, full, node in names.references(tree):
        module, _, last = full.rpartition(".")
        call = calls.get(id(node))
        forbidden = within(full, NEVER) or last in NEVER_BY_LAST_NAME or full.endswith(NEVER_LOADED)
        forbidden |= last == "*" and (node is None or names.is_module_of_others(module))
        forbidden |= full == "json.loads" and name not in READ_PLAINLY | OWN_TEXT
        forbidden |= full in ONLY_SO and not (call and is_constant(call, ONLY_SO[full]))
        forbidden |= full == "yaml.load" and not (name in READ_PLAINLY and call and is_plain_yaml(call))
        if forbidden and not within(full, legitimate):
            yield f"{line}: {full}"
        if full == PROGRAM_PARTS and call and within(constant(call.args[0]), NEVER):
            yield f"{line}: {call.args[0].value}"


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
        "import importlib; importlib.import_module('pickle')",
        "from importlib import import_module as get; get('pickle')",
        "import builtins; builtins.eval(text)",
        "run = eval",
        "import torch; load = torch.load; load(path, weights_only=False)",
        "import torch; load = torch.load; load(path)",
        "import torch; library = torch; library.load(path)",
        "import torch; torch.load(path, weights_only=not 'weights_only=True')",
        "import torch; torch.load('weights_only=True')",
        "import torch; torch.load(path, **{'weights_only': True})",
        "import torch; list(map(torch.load, paths))",
        "from multiprocessing.reduction import ForkingPickler; ForkingPickler.loads(text)",
        "import multiprocessing.reduction as reduction; reduction.ForkingPickler.loads(text)",
        "import yaml; getattr(yaml, 'unsafe_load')(text)",
        "import yaml; getattr(yaml, name)(text)",
        "import yaml; yaml.load(text, _PlainLoader)",
        "from yaml import *",
        "import os; os.popen(text)",
        "from os import popen",
        "import os; os.execv(path, words)",
        "import subprocess; subprocess.run(text, shell=True)",
        "run(text, shell=wanted)",
        "from numpy.lib.npyio import NpzFile; NpzFile(file, allow_pickle=True)",
        "import numpy as np; np.lib.npyio.NpzFile(file)",
        "import numpy as np; np.load(path, allow_pickle='allow_pickle=False')",
        "import _pickle",
        "from pickle import loads",
        "import sys; sys.modules['pickle'].loads(text)",
        "from json import loads",
        "[].append.__globals__",
        "import json; json.loads(text)",
    ],
)
def test_the_search_itself_finds(line):
    assert list(offences(line, "training/new.py"))


@pytest.mark.parametrize(
    "line",
    [
        "import torch; torch.load(path, weights_only=True)",
        "import numpy as np; np.load(path, allow_pickle=False)",
        "import numpy as np; np.lib.format.read_array(file, allow_pickle=False)",
        "import json; json.dumps(data)",
        "import yaml; yaml.safe_dump(data)",
        "import os; getattr(os, 'O_BINARY', 0)",
        "import re; re.compile(text)",
        "from importlib import resources; resources.files(package)",
        "code = text; code.strip()",
        "model.eval(); value = getattr(model, name)",
    ],
)
def test_the_search_leaves_alone(line):
    assert list(offences(line, "training/new.py")) == []


@pytest.mark.parametrize(
    ("name", "line"),
    [
        ("training/cli.py", "import importlib; importlib.import_module('pickle')"),
        ("training/benchmark/limit/__init__.py", "import subprocess; subprocess.run(text, shell=True)"),
        ("passloc_env/reading.py", "import yaml; yaml.load(text, yaml.SafeLoader)"),
        ("passloc_env/compiled/graph.py", "import numpy as np; np.load(path, allow_pickle=True)"),
    ],
)
def test_what_a_file_may_is_no_more_than_it_needs(name, line):
    assert list(offences(line, name))


def test_every_exception_is_needed():
    for name, wholes in LEGITIMATE.items():
        tree = ast.parse((ROOT / name).read_text(encoding="utf-8"))
        referred = [full for _, full, _ in Names(tree).references(tree)]
        assert [whole for whole in wholes if not any(within(full, {whole}) for full in referred)] == []
