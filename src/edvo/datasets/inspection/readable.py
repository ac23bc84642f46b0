"""Frames that cannot be read."""

from collections.abc import Sequence

from edvo.datasets.inspection.finding import Finding

_SHOWN = 5


def check_readable(problems: Sequence[str], looked_at: int) -> Finding:
    """Say which frames cannot be read, the first few by name.

    Parameters
    ----------
    problems : sequence of str
        A line for each.
    looked_at : int
        Frames that were to be read.

    Returns
    -------
    Finding
    """
    warnings = list(problems[:_SHOWN])
    if len(problems) > _SHOWN:
        warnings.append(
            f"skipped {len(problems)} frames in all, of {looked_at} that were looked at"
        )
    measured = {"unreadable": len(problems), "looked_at": looked_at}
    return Finding("readable images", tuple(warnings), measured=measured)
