"""How many cores there are."""

import os


def usable_cores() -> int:
    """Say how many cores this process may use.

    Returns
    -------
    int
        Of all the machine's, where the system does not tell.
    """
    if hasattr(os, "sched_getaffinity"):  # not on a Mac, nor on Windows
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
