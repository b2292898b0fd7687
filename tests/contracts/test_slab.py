"""Arrays that go from process to process by way of shared memory arrive as they were."""

import multiprocessing

import numpy as np
import pytest

from passloc_env.slab import Slab

ANSWER = {
    "numbers": np.arange(12.0).reshape(3, 4),
    "flags": np.array([True, False, True]),
    "nested": [np.zeros((0, 2)), (np.float32([1.5, np.nan]), None)],
    "turned": np.arange(6).reshape(2, 3).T,
    "rows": np.arange(20.0).reshape(4, 5)[:, 1:3],
    "word": "steady",
}


@pytest.mark.parametrize(("size", "fits"), [(4096, True), (64, False)])
def test_an_answer_arrives_as_it_was(size: int, fits: bool, assert_same) -> None:
    slab = Slab(multiprocessing.get_context("spawn"), size)
    parcel = slab.pack(ANSWER)
    assert bool(parcel[1]) == fits
    assert_same(slab.unpack(parcel), ANSWER)


def test_the_next_answer_takes_the_place_of_the_last() -> None:
    """Which is why whoever keeps one must copy it."""
    slab = Slab(multiprocessing.get_context("spawn"), 1024)
    first = slab.unpack(slab.pack(np.zeros(8)))
    second = slab.unpack(slab.pack(np.ones(8)))
    np.testing.assert_array_equal(first, second)
