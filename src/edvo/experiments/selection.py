"""Which sequences and which frames an experiment looks at."""

from collections.abc import Sequence as Items
from typing import TypeVar

import numpy as np

from edvo.experiments.bench import Bench
from edvo.experiments.sequences import Sequence

LONG = "fr3/long_office_household"
"""The paper's sequence of Table I and Fig. 6."""
PLAIN = "fr3/structure_notexture_far"
"""The paper's low-textured sequence of Fig. 7."""

_SLOWEST = 0.1  # seconds between frames that still make a video

Item = TypeVar("Item")


def spread(items: Items[Item], count: int) -> list[Item]:
    """Choose items evenly.

    Parameters
    ----------
    items : sequence
        What to choose from.
    count : int
        How many; all where there are fewer.

    Returns
    -------
    list
        In the same order, the ends left out where there is a choice.
    """
    count = min(count, len(items))
    return [items[(2 * i + 1) * len(items) // (2 * count)] for i in range(count)]


def texture_and_none(bench: Bench) -> list[Sequence]:
    """Give a textured and a plain sequence.

    Parameters
    ----------
    bench : Bench
        Where they are.

    Returns
    -------
    list of Sequence
        The paper's fr3/long or its stand-in, and fr3/structure_notexture_far.
    """
    return bench.sequences([LONG, PLAIN])


def videos(bench: Bench) -> list[Sequence]:
    """Give fr3/long or its stand-in, and all real sequences of many frames a second.

    Parameters
    ----------
    bench : Bench
        Where they are.

    Returns
    -------
    list of Sequence
        Also the plain one's stand-in where there is no real sequence at all.
    """
    real = [s for s in bench.sequences() if s.is_real and is_video(s)]
    chosen = {s.name: s for s in [bench.sequence(LONG), *(real or [bench.sequence(PLAIN)])]}
    return list(chosen.values())


def is_video(sequence: Sequence) -> bool:
    """Say whether frames follow each other as in a video.

    Parameters
    ----------
    sequence : Sequence
        Which.

    Returns
    -------
    bool
        False for one that shows a frame only every now and then.
    """
    stamps = [frame.timestamp for frame in sequence.frames]
    return len(stamps) < 2 or float(np.median(np.diff(stamps))) <= _SLOWEST
