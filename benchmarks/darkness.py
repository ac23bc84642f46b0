"""Darkness: how far a camera is followed by its depth once the light is out, and what comes after.

    python -m benchmarks.darkness [--rooms 24] [--first 0] [--set KEY=VALUE] [--docs]

draws rooms as `benchmarks.rooms` does, and makes the images black for a second and a half. Printed
is how far off the camera is at the end of that, since the last image with light, in mm: of the
preset `default`, of the same by planes of the last keyframe with light alone, as it was before it
followed contours and made keyframes of depth, and of OpenCV's odometry by depth; of edvo, too, how
many frames are lost in the dark, how many in the second after it, and how many say *tracked* and
are wrong.
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace
from textwrap import fill

import cv2
import numpy as np

from benchmarks.frames import ROOT
from benchmarks.honesty import WRONG_M_S
from benchmarks.report import document
from benchmarks.room_drawing import draw
from benchmarks.rooms import COLUMNS, EDVO, described, render, tracker
from benchmarks.section import table
from benchmarks.turning import Recorded
from edvo import se3
from edvo.baselines.registry import Tracker
from edvo.evaluation.honesty import error_speed
from edvo.odometry import Status

PAGE = ROOT / "docs" / "theory" / "depth-alone.md"
MARK = "<!-- measured: written by python -m benchmarks.darkness --docs -->\n"
ROOMS, LIT, DARK, AFTER = 24, 30, 45, 30  # rooms, and frames of each
BEFORE = ("planes.contours=none", "planes.alone_keyframes=none")
PEER = "OpenCV depth"


@dataclass(frozen=True)
class Outcome:
    """What a system made of a room that goes dark.

    Parameters
    ----------
    off_mm : float
        At the last dark frame, since the last with light; infinite where that one is lost.
    lost_in, lost_after : int
        Frames lost in the dark, and in the second after it.
    wrong : int
        Frames that say *tracked* and are wrong.
    """

    off_mm: float
    lost_in: int
    lost_after: int
    wrong: int

    def cells(self) -> list[str]:
        """Put it into cells of a table."""
        off = f"{self.off_mm:.1f}" if np.isfinite(self.off_mm) else "lost"
        return [off, f"{self.lost_in}, {self.lost_after}"]


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rooms", type=int, default=ROOMS, help="how many")
    parser.add_argument("--first", type=int, default=0, help="seed of the first")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    parser.add_argument("--docs", action="store_true", help="put the table into docs/ as well")
    given = parser.parse_args()
    if given.rooms < 1:
        parser.error("--rooms: 1 at least")
    cv2.setNumThreads(1)
    rows, every = [], []
    for seed in range(given.first, given.first + given.rooms):
        room = draw(seed)
        dark = darkened(render(room, LIT + DARK + AFTER))
        outcomes = [
            outcome(dark, tracker(EDVO, dark, given.set)),
            outcome(dark, tracker(EDVO, dark, [*given.set, *BEFORE])),
            outcome(dark, tracker(PEER, dark, [])),
        ]
        cells = [cell for each in outcomes[:2] for cell in each.cells()]
        rows.append([*described(room)[:3], *cells, outcomes[2].cells()[0]])
        every.append(outcomes)
        print(" | ".join(rows[-1]), flush=True)
    words = ["seed", "what it is", "seen by"]
    header = [*words, "edvo, mm", "lost", "by one keyframe's planes, mm", "lost", f"{PEER}, mm"]
    text = table(header, rows, [name not in words for name in header])
    text += f"\n\n{summary(every)}\n"
    print("\n" + text)
    if given.docs:
        document(PAGE.parent, text, page=PAGE, mark=MARK)


def darkened(recorded: Recorded) -> Recorded:
    """Let no light into the images for a while."""
    frames = [
        replace(frame, grey=np.zeros_like(frame.grey)) if LIT <= k < LIT + DARK else frame
        for k, frame in enumerate(recorded.frames)
    ]
    return replace(recorded, frames=frames)


def outcome(recorded: Recorded, system: Tracker) -> Outcome:
    """Track a room and hold what was said against the truth."""
    results = [system.track(frame) for frame in recorded.frames]
    times = np.array([frame.timestamp for frame in recorded.frames])
    truth = np.array([recorded.truth.at(time) for time in times])
    poses = np.array([result.T_world_cam for result in results])
    statuses = np.array([result.status for result in results])
    lost = statuses == Status.LOST
    speed = error_speed(times, truth, poses, ~lost)
    begin, end = LIT - 1, LIT + DARK - 1
    went = [se3.inverse(each[begin]) @ each[end] for each in (truth, poses)]
    return Outcome(
        off_mm=np.inf if lost[end] else 1e3 * se3.distance(*went),
        lost_in=int(np.count_nonzero(lost[LIT : end + 1])),
        lost_after=int(np.count_nonzero(lost[end + 1 :])),
        wrong=int(np.count_nonzero((statuses == Status.TRACKED) & (speed > WRONG_M_S))),
    )


def summary(every: Sequence[Sequence[Outcome]]) -> str:
    """Say what the rooms come to."""
    now, before, peer = ([of[k] for of in every] for k in range(3))
    median = [np.median([each.off_mm for each in of]) for of in (now, before, peer)]
    offs = [f"{value:.1f} mm" if np.isfinite(value) else "lost" for value in median]
    lines = [f"Median: {offs[0]}; by one keyframe's planes {offs[1]}; {PEER} {offs[2]}."]
    for name, of in (("edvo", now), ("edvo by one keyframe's planes", before)):
        lost = [sum(each.lost_in for each in of), sum(each.lost_after for each in of)]
        wrong = sum(each.wrong for each in of)
        lines.append(
            f"Of {len(of) * DARK} dark frames {name} loses {lost[0]}, of the {len(of) * AFTER} "
            f"after them {lost[1]}; {wrong} are *tracked* and wrong."
        )
    return "\n\n".join(fill(line, COLUMNS, break_on_hyphens=False) for line in lines)


if __name__ == "__main__":
    main()
