"""What a comparison comes to, in sentences."""

import math
from collections.abc import Mapping, Sequence

from edvo.report.compare import Comparison, Row

_MOST_NAMED = 6  # baselines that are named one by one
_APART = 1.3  # ratio of wall and processor time beyond which both are said
_ALIKE = 0.05  # relative difference of two times below which neither is the faster one


def verdicts(comparison: Comparison) -> list[str]:
    """Say where edvo stands, a line for each of its presets, and what each change was worth.

    Parameters
    ----------
    comparison : Comparison
        Of one sequence.

    Returns
    -------
    list of str
        Rank by the relative pose error among all that ran, failed ones counted, and how many
        times faster it is than each baseline by the median wall time of a frame.
    """
    lines = [_of_preset(comparison, row) for row in comparison.rows if row.kind == "edvo"]
    changed = [row for row in comparison.rows if row.kind == "variant"]
    return lines + _of_variants(comparison, changed) if changed else lines


def summary_verdicts(comparisons: Sequence[Comparison]) -> list[str]:
    """Say in how many sequences each preset of edvo is first.

    Parameters
    ----------
    comparisons : sequence of Comparison
        Of several sequences.

    Returns
    -------
    list of str
        A line for each preset, where at least two sequences have ground truth.
    """
    ranked = [comparison for comparison in comparisons if comparison.ranked]
    if len(ranked) < 2:
        return []
    lines = []
    for row in comparisons[0].rows:
        if row.kind == "edvo":
            places = [_place(comparison, row.name) for comparison in ranked]
            first = sum(place == 1 for place in places)
            shown = ", ".join("x" if place is None else ordinal(place) for place in places)
            lines.append(f"{row.name}: 1st in {first} of {len(ranked)} sequences by RPE ({shown})")
    return lines


def ordinal(number: int) -> str:
    """Write 1st, 2nd, 3rd, 4th ..."""
    endings = {1: "st", 2: "nd", 3: "rd"}
    teen = number % 100 in (11, 12, 13)
    return f"{number}{'th' if teen else endings.get(number % 10, 'th')}"


def times(ratio: float) -> str:
    """Write a ratio to two digits, with the sign that it is one."""
    return f"{ratio:.0f}x" if ratio >= 9.95 else f"{ratio:.1f}x"


def _place(comparison: Comparison, name: str) -> int | None:
    row = comparison.row(name)
    return None if row is None else comparison.rank(row)


def _of_preset(comparison: Comparison, row: Row) -> str:
    place = comparison.rank(row)
    if place is not None:
        said = f"{ordinal(place)} of {len(comparison.ranked)} in RPE"
    elif row.failure:
        said = f"failed ({row.failure})"
    else:
        said = "no rank, since there is no relative pose error"
    ratios = {
        other.name: ratio
        for other in comparison.rows
        for ratio in [other.times_as_long_as(row)]
        if other.kind == "baseline" and math.isfinite(ratio[0])
    }
    said += "".join(f"; {part}" for part in _speeds(ratios))
    return f"{row.name}: {said}"


def _speeds(ratios: Mapping[str, tuple[float, float]]) -> list[str]:
    """Say how much faster than each; of many, only than the quickest and the slowest of them."""
    left = {name: wall for name, (wall, _) in ratios.items() if wall > 1 + _ALIKE}
    summed_up = len(ratios) > _MOST_NAMED and len(left) > 2
    named = [name for name in ratios if not summed_up or name not in left]
    parts = [", ".join(_speed(name, *ratios[name]) for name in named)] if named else []
    if summed_up:
        ends = min(left, key=left.__getitem__), max(left, key=left.__getitem__)
        shown = " to ".join(f"{times(left[name])} ({name})" for name in ends)
        parts.append(f"{shown} faster than {'the other' if named else 'all'} {len(left)}")
    return parts


def _speed(name: str, wall: float, cpu: float) -> str:
    """Say how much faster than another, by the wall and, if that differs, by processor time."""
    said = f"{_compared(wall)} {'as' if abs(wall - 1) <= _ALIKE else 'than'} {name}"
    if max(wall, cpu) <= _APART * min(wall, cpu):
        return said
    return f"{said} (by processor time {_compared(cpu)})"


def _compared(ratio: float) -> str:
    if abs(ratio - 1) <= _ALIKE:
        return "as fast"
    return f"{times(ratio)} faster" if ratio > 1 else f"{times(1 / ratio)} slower"


def _of_variants(comparison: Comparison, changed: Sequence[Row]) -> list[str]:
    ratios = {row.name: comparison.error_ratio(row) for row in changed if not row.failure}
    ratios = {name: ratio for name, ratio in ratios.items() if math.isfinite(ratio)}
    lost = len(changed) - len(ratios)
    if not ratios:
        return [f"{comparison.base}: no change has an error to compare with"]
    best, worst = min(ratios, key=ratios.__getitem__), max(ratios, key=ratios.__getitem__)
    less = sum(ratio < 1 for ratio in ratios.values())
    line = (
        f"{comparison.base}: {less} of {len(changed)} changes lower the error "
        f"(most: {best}, {ratios[best]:.2f}x), {len(ratios) - less} do not "
        f"(least good: {worst}, {ratios[worst]:.2f}x)"
    )
    return [line + (f", {lost} fail" if lost else "")]
