"""The rows of a state are named once and add up."""

import numpy as np
import pytest

from passloc_env.layout import StateLayout

LAYOUTS = [
    StateLayout(dimension, order, nuisance)
    for dimension in (2, 3)
    for order in (1, 2)
    for nuisance in ((), ("carrier_offset",), ("turn_rate", "carrier_offset"))
]


@pytest.mark.parametrize("layout", LAYOUTS, ids=str)
def test_blocks_partition_the_state(layout: StateLayout) -> None:
    rows = np.arange(layout.size)
    blocks = [rows[b] for b in (layout.position, layout.velocity, layout.acceleration, layout.nuisances)]
    np.testing.assert_array_equal(np.concatenate(blocks), rows)
    assert [len(block) for block in blocks[:3]] == [
        layout.dimension,
        layout.dimension,
        layout.dimension * (layout.order - 1),
    ]
    np.testing.assert_array_equal(rows[layout.kinematic], np.concatenate(blocks[:3]))


@pytest.mark.parametrize("layout", LAYOUTS, ids=str)
def test_every_row_has_a_name_of_its_own(layout: StateLayout) -> None:
    assert len(set(layout.names)) == len(layout.names) == layout.size
    for name in layout.nuisance:
        assert layout.names[layout.nuisance_row(name)] == name


def test_names_by_hand() -> None:
    assert StateLayout(2, 1, ("bias",)).names == ("east", "north", "east velocity", "north velocity", "bias")
    assert StateLayout(3, 2).names[::4] == ("x", "y velocity", "z acceleration")


def test_unknown_nuisance_lists_the_known() -> None:
    with pytest.raises(KeyError, match="'bias'; known: carrier_offset"):
        StateLayout(2, 1, ("carrier_offset",)).nuisance_row("bias")


def test_nuisances_are_appended() -> None:
    layout = StateLayout(2, 1, ("turn_rate",)).with_nuisance(("carrier_offset",))
    assert (layout.nuisance_row("turn_rate"), layout.nuisance_row("carrier_offset")) == (4, 5)


PAIRS = [(a, b) for a in LAYOUTS for b in LAYOUTS if a.dimension == b.dimension]


@pytest.mark.parametrize(("source", "target"), PAIRS, ids=str)
def test_convert_matches_rows_by_name(source: StateLayout, target: StateLayout) -> None:
    state = 1.0 + np.arange(source.size * 3.0).reshape(source.size, 3)
    converted = target.convert(state, source)
    known = dict(zip(source.names, state, strict=True))
    for name, row in zip(target.names, converted, strict=True):
        np.testing.assert_array_equal(row, known.get(name, np.zeros(3)))
    assert (converted is state) == (source == target)


def test_units_by_hand() -> None:
    assert StateLayout(2, 2).units({}) == ("m", "m", "m/s", "m/s", "m/s²", "m/s²")
    assert StateLayout(3, 1, ("turn_rate",)).units({"turn_rate": "rad/s"}) == (*"mmm", *3 * ("m/s",), "rad/s")
