"""Messages of one topic waiting for their block to be full: a ring of blocks, each rows of bytes.

The servo loop writes; whoever sends the closed blocks may be another thread.
"""

import numpy as np

from microstage_ros.numerics.compiled import in_place

SLOTS = 64
"""Blocks in the ring."""


def new_ring(most, size):
    """A ring of blocks of at most ``most`` messages [1] of ``size`` [byte]: rows, fill, ends.

    Returns
    -------
    rows : uint8 (SLOTS, most, size). fill : int64 (SLOTS, 2), messages in each block and the number of its first.
    ends : int64 (2,), how many blocks have been closed, and how many of them sent.
    """
    return np.zeros((SLOTS, most, size), np.uint8), np.zeros((SLOTS, 2), np.int64), np.zeros(2, np.int64)


@in_place
def close(ring):
    """Close the block that is being filled, if there is anything in it and room for another. True if it did."""
    rows, fill, ends = ring
    if fill[ends[0] % SLOTS, 0] == 0 or ends[0] - ends[1] >= SLOTS - 1:
        return False
    fill[(ends[0] + 1) % SLOTS, 0] = 0
    ends[0] += 1
    return True


@in_place
def crowded(ring):
    """True if little room is left: whoever sends is late."""
    return ring[2][0] - ring[2][1] >= SLOTS - 3


@in_place
def keep(ring, raw, sequence):
    """Append the message ``raw``, uint8 of shape (size,); False if there is no room. A full block is closed first."""
    rows, fill, ends = ring
    slot = ends[0] % SLOTS
    if fill[slot, 0] == rows.shape[1]:
        if not close(ring):
            return False
        slot = ends[0] % SLOTS
    count = fill[slot, 0]
    if count == 0:
        fill[slot, 1] = sequence
    for k in range(raw.size):
        rows[slot, count, k] = raw[k]
    fill[slot, 0] = count + 1
    return True
