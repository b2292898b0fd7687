"""Components: frozen dataclasses whose fields say what they accept, and check it.

Every part of a scenario (sensor, platform, motion, tracker, reward term …) is a frozen dataclass deriving from
:class:`Component`. Its fields are declared with :func:`quantity`, :func:`count`, :func:`option`, :func:`part` and their
like, which carry unit, limits and one line of documentation. That single declaration validates the value, decodes it
from JSON or YAML, and fills the documentation tables.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from passloc_env.errors import ScenarioError, unknown_name


@dataclass(frozen=True)
class Spec:
    """What one field accepts."""

    doc: str
    unit: str = ""

    def check(self, name: str, value: Any) -> Any:
        """The value in its normal form; raises :class:`ScenarioError` when it is not allowed."""
        return value


class Component:
    """Base of everything a scenario is made of; subclasses are frozen dataclasses, known by their class name."""

    registry: ClassVar[dict[str, type[Component]]] = {}

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        Component.registry[cls.__name__] = cls

    def __post_init__(self) -> None:
        for name, spec in specs(type(self)).items():
            object.__setattr__(self, name, spec.check(name, getattr(self, name)))
        self.validate()

    def validate(self) -> None:
        """Check what no single field can; overridden by components that need it."""


def specs(kind: type[Component]) -> Mapping[str, Spec]:
    """The declared fields of a component class, in order."""
    if kind not in _SPECS:
        _SPECS[kind] = {f.name: f.metadata["spec"] for f in dataclasses.fields(kind)}  # type: ignore[arg-type]
    return _SPECS[kind]


_SPECS: dict[type[Component], Mapping[str, Spec]] = {}


def concrete(kind: type[Component]) -> dict[str, type[Component]]:
    """The classes of a kind that can be built, by name."""
    known = Component.registry.items()
    return {name: found for name, found in known if issubclass(found, kind) and dataclasses.is_dataclass(found)}


def from_dict(
    data: Mapping[str, Any], default: type[Component] | None = None, kind: type[Component] = Component
) -> Component:
    """Build a component from plain data.

    Args:
        data: the fields by name; ``type`` names the class.
        default: the class when ``type`` is absent.
        kind: what is wanted, for the list of types when ``type`` names none.

    Raises:
        ScenarioError: unknown type or field (with the closest valid one), missing field, impossible value.
    """
    if not isinstance(data, Mapping):
        raise ScenarioError("", data, "must be a mapping of fields")
    fields = dict(data)
    name = fields.pop("type", None)
    if name is None and default is not None:
        built = default
    elif isinstance(name, str) and name in Component.registry and dataclasses.is_dataclass(Component.registry[name]):
        built = Component.registry[name]
    else:
        raise unknown_name("type", name, concrete(kind), "component type")
    known = specs(built)
    for key in fields:
        if key not in known:
            raise unknown_name(str(key), fields[key], known, f"field of {built.__name__}", name=key)
    required = {f.name for f in dataclasses.fields(built) if is_required(f)}  # type: ignore[arg-type]
    for key in sorted(required - set(fields)):
        raise ScenarioError(key, None, f"{built.__name__} needs it: {known[key].doc}")
    return built(**fields)


def is_required(field: dataclasses.Field[Any]) -> bool:
    """Whether a dataclass field has no default."""
    return field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING


def to_dict(component: Component) -> dict[str, Any]:
    """Plain data (JSON and YAML safe) from which :func:`from_dict` builds an equal component."""
    plain: dict[str, Any] = {"type": type(component).__name__}
    for name in specs(type(component)):
        plain[name] = _plain(getattr(component, name))
    return plain


def _plain(value: Any) -> Any:
    if isinstance(value, Component):
        return to_dict(value)
    if isinstance(value, tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float) and math.isinf(value):
        return "inf" if value > 0 else "-inf"
    return value
