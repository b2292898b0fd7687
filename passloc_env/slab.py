"""Memory that two processes share: the arrays of an answer are laid down there and need not go through a pipe."""

from __future__ import annotations

import pickle
from multiprocessing.context import BaseContext
from typing import Any

import numpy as np

_ALIGNED = 64
"""Arrays begin at multiples of a cache line."""

Parcel = tuple[bytes, list[tuple[int, int]]]
"""An answer without its arrays, and where in the slab each of these begins and ends; none where they came along."""


class Slab:
    """So many bytes, shared with a process to which the slab is given when it starts."""

    def __init__(self, context: BaseContext, size: int) -> None:
        self._memory = context.RawArray("B", size)

    def pack(self, answer: Any) -> Parcel:
        """Lay the arrays of an answer down, unless there are too many for the slab: then they come along."""
        buffers: list[pickle.PickleBuffer] = []
        head = pickle.dumps(answer, protocol=5, buffer_callback=buffers.append)
        flat = [np.frombuffer(buffer.raw(), np.uint8) for buffer in buffers]
        places, end = [], 0
        for part in flat:
            places.append((end, end + len(part)))
            end += -(-len(part) // _ALIGNED) * _ALIGNED
        memory = np.frombuffer(self._memory, np.uint8)
        if end > len(memory):
            return pickle.dumps(answer, protocol=5), []
        for part, (first, last) in zip(flat, places, strict=True):
            memory[first:last] = part
        return head, places

    def unpack(self, parcel: Parcel) -> Any:
        """The answer; its arrays are views of the slab, good until the next one is packed."""
        head, places = parcel
        memory = memoryview(self._memory).cast("B")
        return pickle.loads(head, buffers=[memory[first:last] for first, last in places])
