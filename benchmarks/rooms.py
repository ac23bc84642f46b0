"""Rooms drawn at random: what edvo and others say in places that nobody chose.

    python -m benchmarks.rooms [--rooms 24] [--first 0] [--frames 120] [--others] [--docs]
    python -m benchmarks.rooms --only 3,7 --set status.min_told=0

draws a room by each seed, with a camera, its way, its sensor and shutter, and lamps; renders it
once, and tracks it by the preset `default`, with ``--others`` by four others of `edvo compare` as
well. Printed are root mean squares of the relative pose error over one second (TUM), the shares of
the frames that edvo calls *tracked*, *degraded* and *lost*, and how many say *tracked* and are
wrong by more than 0.1 m within the last second; of the others the share that has a pose. Below the
table stands how many errors of *tracked* frames lie where their covariance says.
"""

import argparse
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from textwrap import fill

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from benchmarks.frames import ROOT
from benchmarks.honesty import WRONG_M_S
from benchmarks.report import document
from benchmarks.room_drawing import Room, draw
from benchmarks.section import table
from benchmarks.turning import Recorded
from edvo import se3
from edvo.baselines.registry import Tracker, make_tracker
from edvo.config import Config
from edvo.datasets import read_ahead
from edvo.errors import EvaluationError
from edvo.evaluation import evaluate
from edvo.evaluation.honesty import error_speed
from edvo.odometry import Odometry, Status, TrackedFrame
from edvo.synthesis.sequence import SyntheticSource

PAGE = ROOT / "docs" / "rooms.md"
MARK = "<!-- measured: written by python -m benchmarks.rooms --docs -->\n"
ROOMS, FRAMES = 24, 120
COLUMNS = 100  # of prose
REGION = float(chi2.ppf(0.9, 6))
ENOUGH = 0.5  # share of the frames that has to have a pose
EDVO = "edvo"
OTHERS = {
    "OpenCV RGB-D": "opencv-rgbd",
    "OpenCV depth": "opencv-depth",
    "ORB with PnP": "orb-pnp",
    "direct": "direct-t",
}


@dataclass(frozen=True)
class Score:
    """What a system made of a room.

    Parameters
    ----------
    error : float
        RPE over one second (rms), mm/s; infinite where too little has a pose.
    tracked, degraded, lost : int
        Frames that say so.
    wrong : int
        Tracked frames that are wrong.
    told, inside : int
        Tracked frames with a covariance, and those whose error is in its 90 % region.
    """

    error: float
    tracked: int
    degraded: int
    lost: int
    wrong: int
    told: int = 0
    inside: int = 0

    @property
    def frames(self) -> int:
        """All of them."""
        return self.tracked + self.degraded + self.lost

    @property
    def posed(self) -> float:
        """Share of the frames that has a pose."""
        return 1 - self.lost / self.frames

    @property
    def counted(self) -> float:
        """The error, but infinite where too few frames have a pose."""
        return self.error if self.posed >= ENOUGH else np.inf


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rooms", type=int, default=ROOMS, help="how many")
    parser.add_argument("--first", type=int, default=0, help="seed of the first")
    parser.add_argument("--frames", type=int, default=FRAMES, help="of each")
    parser.add_argument("--only", default="", help="seeds, joined by commas, in place of these")
    parser.add_argument("--others", action="store_true", help="track by other systems, too")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    parser.add_argument(
        "--docs",
        action="store_true",
        help="all rooms and systems, into docs/ as well",
    )
    given = parser.parse_args()
    if given.rooms < 1:
        parser.error("--rooms: 1 at least")
    seeds: Sequence[int] = range(given.first, given.first + given.rooms)
    if given.only:
        seeds = [int(seed) for seed in given.only.split(",")]
    frames, others = given.frames, given.others
    if given.docs:
        changed = (given.rooms, given.first, given.frames) != (ROOMS, 0, FRAMES)
        if changed or given.set or given.only:
            parser.error("--docs is of the usual rooms and frames, by the preset as it is")
        others = True
    cv2.setNumThreads(1)
    measured = tabulate(map(draw, seeds), frames, given.set, others=others)
    if given.docs:
        document(PAGE.parent, measured, page=PAGE, mark=MARK)


def tabulate(
    rooms: Iterable[Room], count: int, changes: Sequence[str] = (), *, others: bool = False
) -> str:
    """Render rooms, track them, and print what came out.

    Parameters
    ----------
    rooms : iterable of Room
    count : int
        Frames of each.
    changes : sequence of str, optional
        Overrides of edvo's preset `default`.
    others : bool, optional
        Whether other systems get the same frames.

    Returns
    -------
    str
        The table, and what it comes to.
    """
    systems = (EDVO, *(OTHERS if others else ()))
    words = ["seed", "what it is", "seen by", "light"]
    header = [*words, "edvo", "tracked, degraded, lost", "wrong", *systems[1:]]
    right = [name not in words for name in header]
    rows, every = [], []
    for room in rooms:
        recorded = render(room, count)
        scores = {name: score(recorded, tracker(name, recorded, changes)) for name in systems}
        cells = [cell(scores[name]) for name in systems[1:]]
        rows.append([*described(room), *states(scores[EDVO]), *cells])
        every.append(scores)
        print(" | ".join(rows[-1]), flush=True)
    text = f"{table(header, rows, right)}\n\n{summary(every)}\n"
    print("\nRPE, mm/s; share of the frames\n\n" + text)
    return text


def render(room: Room, count: int) -> Recorded:
    """Render so many frames of a room."""
    source = SyntheticSource(room.recipe(count))
    readings = read_ahead(source, range(count))
    frames = [reading.frame for reading in readings if reading.frame is not None]
    return Recorded(source.camera, frames, source.ground_truth)


def tracker(name: str, recorded: Recorded, changes: Sequence[str]) -> Tracker:
    """Make a system by its name in the table."""
    if name == EDVO:
        return Odometry(recorded.camera, Config().with_overrides(changes))
    return make_tracker(OTHERS[name], recorded.camera)


def score(recorded: Recorded, system: Tracker) -> Score:
    """Track a room and hold what was said against the truth."""
    frames = recorded.frames
    results = [system.track(frame) for frame in frames]
    times = np.array([frame.timestamp for frame in frames])
    truth = np.array([recorded.truth.at(time) for time in times])
    poses = np.array([result.T_world_cam for result in results])
    statuses = np.array([result.status for result in results])
    tracked, lost = statuses == Status.TRACKED, statuses == Status.LOST
    speed = error_speed(times, truth, poses, ~lost)
    inside = [is_inside(result, truth) for result in results if has_region(result)]
    return Score(
        error=relative_error(recorded, system),
        tracked=int(np.count_nonzero(tracked)),
        degraded=int(np.count_nonzero(~tracked & ~lost)),
        lost=int(np.count_nonzero(lost)),
        wrong=int(np.count_nonzero(tracked & (speed > WRONG_M_S))),
        told=len(inside),
        inside=sum(inside),
    )


def has_region(result: TrackedFrame) -> bool:
    """Whether a frame is tracked, and it is said how far its pose may be off."""
    known = result.covariance is not None and result.keyframe >= 0
    return known and result.status is Status.TRACKED


def is_inside(result: TrackedFrame, truth: NDArray[np.float64]) -> bool:
    """Whether the motion since the keyframe is off by no more than its 90 % region allows."""
    assert result.covariance is not None
    T_true = se3.inverse(truth[result.keyframe]) @ truth[result.index]
    error = se3.log(T_true @ se3.inverse(result.T_key_cur))
    return float(error @ np.linalg.solve(result.covariance, error)) < REGION


def relative_error(recorded: Recorded, system: Tracker) -> float:
    """RPE over one second, mm/s; infinite where too little has a pose."""
    try:
        found = evaluate(recorded.truth, system.trajectory, len(recorded.frames)).rpe
    except EvaluationError:
        return np.inf
    return np.inf if found is None else 1e3 * found.rmse


def described(room: Room) -> list[str]:
    """Say in a few words what was drawn."""
    plan, filming = room.plan, room.filming
    what = f"{plan.kind}, {plan.width:.1f} x {plan.length:.1f} m"
    what += f", {'plain' if plan.plain else 'textured'}"
    if room.people:
        what += f", {room.people} {'person' if room.people == 1 else 'people'}"
    if filming.motion != "handheld":
        what += f", {filming.motion}"
    camera, shutter = filming.camera, filming.shutter
    seen = f"`{filming.sensor}`, {camera.width} x {camera.height}"
    seen += f", {1e3 * shutter.exposure:.0f} ms" if shutter.exposure else ""
    seen += f", rows in {1e3 * shutter.readout:.0f} ms" if shutter.readout else ""
    light = f"`{filming.light}`" if filming.light else "constant"
    light += ", auto-exposed" if filming.exposure else ""
    return [str(room.seed), what, seen, light]


def states(of: Score) -> list[str]:
    """Put what edvo said into cells."""
    shares = (f"{100 * part / of.frames:.0f}" for part in (of.tracked, of.degraded, of.lost))
    return [written(of.error), f"{', '.join(shares)} %", str(of.wrong)]


def cell(of: Score) -> str:
    """Put the error of another system, and the share that has a pose, into a cell."""
    return f"{written(of.error)}; {100 * of.posed:.0f} %"


def written(error: float) -> str:
    """Write an error, or that there is none."""
    return f"{error:.{0 if error >= 100 else 1}f}" if np.isfinite(error) else "none"


def summary(every: Sequence[Mapping[str, Score]]) -> str:
    """Say what the rooms come to, of all systems and of edvo's own word."""
    lines = []
    systems = list(every[0])
    if len(systems) > 1:
        first = sum(least(scores) == EDVO for scores in every)
        lines.append(
            f"edvo has the least error in {first} of {len(every)} rooms, among the systems that "
            "have a pose for at least half of the frames."
        )
    medians = ", ".join(median_of(name, [scores[name] for scores in every]) for name in systems)
    lines.append(
        "Median of the errors, mm/s, where a system without so many poses has failed, and is worse "
        f"than any other: {medians}."
    )
    own = [scores[EDVO] for scores in every]
    frames, wrong = sum(one.frames for one in own), sum(one.wrong for one in own)
    tracked, degraded = sum(one.tracked for one in own), sum(one.degraded for one in own)
    lines.append(
        f"Of {frames} frames edvo calls {tracked} *tracked*, of which {wrong} are wrong, "
        f"{degraded} *degraded* and {frames - tracked - degraded} *lost*."
    )
    told, inside = sum(one.told for one in own), sum(one.inside for one in own)
    if told:
        lines.append(
            f"Of {told} errors of *tracked* frames, as against their keyframes, "
            f"{100 * inside / told:.0f} % lie in the 90 % region of their covariance."
        )
    return "\n\n".join(fill(line, COLUMNS, break_on_hyphens=False) for line in lines)


def median_of(name: str, scores: Sequence[Score]) -> str:
    """Write the median error of a system, and in how many rooms it failed."""
    errors = [one.counted for one in scores]
    failed = sum(not np.isfinite(error) for error in errors)
    median = f"{name} {written(float(np.median(errors)))}"
    return f"{median} (failed in {failed})" if failed else median


def least(scores: Mapping[str, Score]) -> str | None:
    """Name the system with the least error of those with enough poses, if there is one."""
    name = min(scores, key=lambda name: scores[name].counted)
    return name if np.isfinite(scores[name].counted) else None


if __name__ == "__main__":
    main()
