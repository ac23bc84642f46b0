"""Random numbers that depend on what they are for and not on the order in which they are drawn."""

import struct
from zlib import crc32

import numpy as np


def generator(seed: int, purpose: str, *keys: int | float) -> np.random.Generator:
    """Make the random generator of one thing, such as the depth noise of one frame.

    Parameters
    ----------
    seed : int
        The seed of the whole sequence, 0 or more.
    purpose : str
        What the numbers are for: two purposes are independent of each other.
    keys : int or float
        Which one of these things: a frame index, or the bits of a time in seconds.

    Returns
    -------
    numpy.random.Generator
        The same for the same arguments, in any process.
    """
    words = [seed, crc32(purpose.encode())]
    for key in keys:
        pattern = struct.pack("<d", key) if isinstance(key, float) else struct.pack("<q", key)
        words.extend(struct.unpack("<2I", pattern))
    return np.random.default_rng(np.random.SeedSequence(words))
