"""The Gymnasium ids, registered on ``import passloc_env``."""

from __future__ import annotations

import importlib.machinery
import sys
from collections.abc import Sequence
from importlib.abc import Loader, MetaPathFinder
from types import ModuleType

_GYMNASIUM = "gymnasium"


def register() -> None:
    """Register every named scenario; doing it twice changes nothing.

    The environments truncate themselves, so no ``max_episode_steps``: a registered limit would add a wrapper that
    ignores an overridden episode.
    """
    import gymnasium

    from passloc_env.scenarios import SCENARIOS, environment_id

    for name in SCENARIOS:
        identifier = environment_id(name)
        if identifier not in gymnasium.registry:
            gymnasium.register(
                id=identifier,
                entry_point="passloc_env.env:LocalisationEnv",
                vector_entry_point="passloc_env.vector_env:LocalisationVectorEnv",
                kwargs={"scenario": name},
            )


def register_with_gymnasium() -> None:
    """Register now if Gymnasium is imported, else as soon as it is: who never asks for it does not wait for it."""
    if _GYMNASIUM in sys.modules:
        register()
    elif not any(isinstance(finder, _Awaiting) for finder in sys.meta_path):
        sys.meta_path.insert(0, _Awaiting())


class _Awaiting(MetaPathFinder):
    """Stands before the other finders until Gymnasium has been imported; who only looks for it finds what they find."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        if fullname != _GYMNASIUM:
            return None
        others = [finder for finder in sys.meta_path if finder is not self]
        found = (finder.find_spec(fullname, path, target) for finder in others)
        spec = next(filter(None, found), None)
        if spec is not None and spec.loader is not None:
            spec.loader = _ThenRegister(spec.loader, self)
        return spec


class _ThenRegister(Loader):
    """Loads Gymnasium as its own loader does; then come our ids, and nobody waits any more."""

    def __init__(self, loader: Loader, awaiting: _Awaiting) -> None:
        self._loader, self._awaiting = loader, awaiting

    def create_module(self, spec: importlib.machinery.ModuleSpec) -> ModuleType | None:
        return self._loader.create_module(spec)

    def exec_module(self, module: ModuleType) -> None:
        module.__loader__ = self._loader
        if module.__spec__ is not None:
            module.__spec__.loader = self._loader
        self._loader.exec_module(module)
        if self._awaiting in sys.meta_path:
            sys.meta_path.remove(self._awaiting)
        register()
