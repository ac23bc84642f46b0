"""Honest states: frames called tracked that are wrong, and good frames called lost.

    python -m benchmarks.honesty [--data FOLDER] [--only office,crowd] [--kinds none,arm]
    python -m benchmarks.honesty --light ambient+diffuse --severity 0.5 --kinds none

takes the rendered scenes and the real sequences that there are, as they are and broken for a
second, and prints for each how many frames say ``tracked`` and are wrong, and how many good ones
say ``lost``, then which frames these are.

A tracked frame is wrong

- if within the last second the trajectory went wrong by more than 0.1 m: see
  ``edvo.evaluation.honesty.error_speed``. The truth is that at the frame's stamp: the camera moves
  on while its images are frozen, black or covered;
- whatever its pose, if its images do not come from where the camera is: they are another camera's,
  or have been frozen for more than half a second. The first half second of a freeze is not counted.

A frame is good where nothing is broken, from one second after the breakage on: so long may finding
back take. A good frame that says ``lost`` counts apart, after a plus sign, where it shows a place
never seen: where, by the truth, of no keyframe taken before it, of images as they were, 65 % of its
depth points are in view with that keyframe's depth. So many have to fit for a place to be found
(``status.doubt_inliers``); to be lost is then the only honest answer. Both numbers are printed.

With ``--light`` the lamps of the rendered scenes change, and images of real sequences are relit.
"""

import argparse
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.frames import DATA
from benchmarks.section import table
from edvo.camera import Camera
from edvo.config import Config
from edvo.datasets import open_source, read_ahead
from edvo.datasets.source import Source
from edvo.errors import TrajectoryError
from edvo.evaluation.honesty import error_speed
from edvo.frame import Frame
from edvo.odometry import Odometry, Status, TrackedFrame
from edvo.synthesis.breakage import BREAKAGES, Shown, broken
from edvo.synthesis.light import LightSignal
from edvo.synthesis.relighting import Relighter, RelitSource
from edvo.synthesis.scene import Scene, load_scene
from edvo.synthesis.scene_lights import scene_light
from edvo.synthesis.sequence import SyntheticSource, make_recipe
from edvo.trajectory import Trajectory

# With the first frame of each, which is where a white wall fills the view; each is shown frames of
# the one before it, so no two that show the same place stand together.
SCENES = {
    "texture_far": 0,
    "cabinet": 0,
    "texture_near": 0,
    "office": 0,
    "notexture_far": 0,
    "corridor": 0,
    "notexture_near": 0,
    "stairs": 0,
    "white_wall": 100,
    "crowd": 0,
}
REAL = (
    "tum_fr3_structure_notexture_far",
    "tum_fr1_xyz",
    "icl_office_kt3",
    "tum_fr3_cabinet_sparse",
)
INTACT = "none"
KINDS = (INTACT, *BREAKAGES)
FRAMES, SEED = 150, 3
BREAKS_AT, BREAK_S, BREAK_FRAMES = 0.4, 1.0, 4  # share of the way; and for how long, at least
WRONG_M_S, FREEZE_S, RECOVERY_S = 0.1, 0.5, 1.0
FOREIGN = 45
POINTS_EVERY, SAME_DEPTH_M, SAME_DEPTH = 16, 0.03, 0.03  # pixels; and how far a depth may be off


@dataclass(frozen=True)
class Light:
    """A light that changes, or does not."""

    model: str
    severity: float
    seed: int

    def of(self, scene: Scene) -> LightSignal:
        """Let the lamps of a scene change."""
        state = scene.lights.state()
        return scene_light(self.model, state, severity=self.severity, seed=self.seed)

    def on(self, source: Source) -> Source:
        """Relight a source."""
        if self.model == "constant":
            return source
        return RelitSource(source, Relighter(self.model, severity=self.severity, seed=self.seed))


@dataclass(frozen=True)
class Recorded:
    """Frames in memory, with truth."""

    name: str
    camera: Camera
    frames: list[Frame]
    truth: NDArray[np.float64]
    first: int  # index of the first in its source


@dataclass(frozen=True)
class Outcome:
    """What a tracker said of a stream, frame by frame."""

    shown: list[Shown]
    results: list[TrackedFrame]
    speed: NDArray[np.float64]
    wrong: NDArray[np.bool_]
    good: NDArray[np.bool_]
    unseen: NDArray[np.bool_]

    @property
    def tracked(self) -> NDArray[np.bool_]:
        """Frames that say so."""
        return _status(self.results, Status.TRACKED)

    @property
    def lost(self) -> NDArray[np.bool_]:
        """Good frames that say they are lost, at places that were seen before."""
        return self.good & _status(self.results, Status.LOST) & ~self.unseen

    @property
    def recovery(self) -> float:
        """Seconds from the end of the breakage to the first frame not lost; NaN where there is
        none."""
        faults = [i for i, shown in enumerate(self.shown) if shown.fault]
        if not faults:
            return float("nan")
        end = faults[-1] + 1
        for shown, result in zip(self.shown[end:], self.results[end:], strict=True):
            if result.status is not Status.LOST:
                return shown.timestamp - self.shown[end].timestamp
        return float("nan")


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, default=DATA, help="folder of the real sequences")
    parser.add_argument("--only", default="", help="names of sequences, joined by commas")
    parser.add_argument("--kinds", default=",".join(KINDS), help="breakages, joined by commas")
    parser.add_argument("--preset", default="default")
    parser.add_argument("--set", action="append", default=[], metavar="KEY=VALUE")
    parser.add_argument("--seed", type=int, default=SEED, help="of the rendered scenes and light")
    parser.add_argument("--light", default="constant", help="ambient+diffuse, exposure, fade")
    parser.add_argument("--severity", type=float, default=0.5, help="how hard, up to 1")
    arguments = parser.parse_args()
    light = Light(arguments.light, arguments.severity, arguments.seed)
    cv2.setNumThreads(1)
    config = Config.preset(arguments.preset).with_overrides(arguments.set)
    names = arguments.only.split(",") if arguments.only else [*SCENES, *REAL]
    kinds = arguments.kinds.split(",")
    rows, notes, sums = [], [], Counter[str]()
    for recorded, foreign in sequences(names, arguments.data, light):
        cells = [recorded.name]
        for kind in kinds:
            outcome = judge(recorded, kind, foreign, config)
            cells.append(cell(outcome))
            notes += remarks(recorded, kind, outcome)
            for key in ("tracked", "wrong", "good", "lost", "unseen"):
                sums[key] += int(np.count_nonzero(getattr(outcome, key)))
        rows.append(cells)
        print(" | ".join(cells), flush=True)
    print("\nFrames tracked but wrong / good ones lost + lost at a place never seen; in brackets")
    print("the fastest error of a tracked frame, m/s, and seconds from the end of the breakage to")
    print("the first pose again.\n")
    print(table(["sequence", *kinds], rows))
    print(f"\n{share(sums['wrong'], sums['tracked'])} tracked frames are wrong.")
    print(f"{share(sums['lost'], sums['good'])} good frames are lost where they have been before,")
    print(f"{share(sums['unseen'], sums['good'])} where they have not.\n")
    print("\n".join(notes))


def sequences(
    names: Sequence[str], data: Path, light: "Light"
) -> Iterator[tuple[Recorded, list[Frame]]]:
    """Give each sequence, and frames of another one."""
    foreign: list[Frame] = []
    for name in names:
        if name in REAL and not (data / name).is_dir():
            print(f"{name}: not in {data}; left out")
            continue
        recorded = load(name, data, light)
        if not foreign:
            other = next(scene for scene in SCENES if scene != name)
            foreign = load(other, data, light, FOREIGN).frames
        yield recorded, foreign
        foreign = recorded.frames[:FOREIGN]


def load(name: str, data: Path, light: "Light", count: int = FRAMES) -> Recorded:
    """Render or read the frames; those without depth are left out."""
    first = SCENES.get(name, 0)
    source: Source
    if name in REAL:
        source = light.on(open_source(data / name))
    else:
        scene = load_scene(name)
        lamps = light.of(scene)
        recipe = make_recipe(scene, frames=first + count, seed=light.seed, light=lamps)
        source = SyntheticSource(recipe)
    indices = range(first, min(first + count, len(source)))
    readings = read_ahead(source, indices)
    frames = [reading.frame for reading in readings if reading.frame is not None]
    reference = source.ground_truth
    assert reference is not None, f"{name} has no ground truth"
    truth = np.array([_truth(reference, frame.timestamp) for frame in frames])
    return Recorded(name, source.camera, frames, truth, first)


def judge(recorded: Recorded, kind: str, foreign: Sequence[Frame], config: Config) -> Outcome:
    """Break a sequence, track it, and hold what was said against the truth."""
    frames = recorded.frames
    times = np.array([frame.timestamp for frame in frames])
    start = int(BREAKS_AT * len(frames))
    end = max(int(np.searchsorted(times, times[start] + BREAK_S)), start + BREAK_FRAMES)
    shown = [Shown(frame.timestamp, frame) for frame in frames]
    good = np.ones(len(frames), bool)
    if kind != INTACT:
        shown = broken(kind, frames, start, end, camera=recorded.camera, foreign=foreign)
        good[start:] = times[start:] >= times[end] + RECOVERY_S
    odometry = Odometry(recorded.camera, config)
    results = [
        odometry.skip(one.timestamp, "no depth") if one.frame is None else odometry.track(one.frame)
        for one in shown
    ]
    fresh = times < times[start] + FREEZE_S
    frozen = np.array([one.fault == "frozen" for one in shown])
    elsewhere = np.array([one.fault == "swapped" for one in shown]) | (frozen & ~fresh)
    tracked = _status(results, Status.TRACKED)
    poses = np.array([result.T_world_cam for result in results])
    given = ~_status(results, Status.LOST) & ~elsewhere & ~frozen
    speed = np.where(tracked, error_speed(times, recorded.truth, poses, given), np.nan)
    wrong = (speed > WRONG_M_S) | (elsewhere & tracked)
    unseen = np.zeros(len(frames), bool)
    for i in np.flatnonzero(good & _status(results, Status.LOST)).tolist():
        unseen[i] = known_share(recorded, shown, results, i) < config.status.doubt_inliers
    return Outcome(shown, results, speed, wrong, good, unseen)


def known_share(
    recorded: Recorded, shown: Sequence[Shown], results: Sequence[TrackedFrame], index: int
) -> float:
    """Say how much of a frame the keyframe before it saw that saw most of it, by the truth."""
    keys = [k for k in range(index) if results[k].is_keyframe and not shown[k].fault]
    frames, truth = recorded.frames, recorded.truth
    return max(
        (
            overlap(
                recorded.camera, frames[k], frames[index], np.linalg.inv(truth[k]) @ truth[index]
            )
            for k in keys
        ),
        default=0.0,
    )


def overlap(camera: Camera, key: Frame, frame: Frame, T_key_frame: NDArray[np.float64]) -> float:
    """Share of a frame's depth points that are in a keyframe's view, with the depth found there."""
    depth = frame.depth[::POINTS_EVERY, ::POINTS_EVERY].astype(np.float64)
    v, u = np.nonzero(depth > 0)
    pixels = POINTS_EVERY * np.stack([u, v], axis=1).astype(np.float64)
    points = camera.backproject(pixels, depth[v, u]) @ T_key_frame[:3, :3].T + T_key_frame[:3, 3]
    ahead = points[points[:, 2] > 0]
    if not len(ahead) or not np.isfinite(ahead).all():
        return 0.0
    u, v = np.rint(camera.project(ahead)).astype(np.int64).T
    inside = (u >= 0) & (v >= 0) & (u < camera.width) & (v < camera.height)
    z, there = ahead[inside, 2], key.depth[v[inside], u[inside]]
    same = (there > 0) & (np.abs(there - z) < SAME_DEPTH_M + SAME_DEPTH * z)
    return float(np.count_nonzero(same)) / len(points)


def cell(outcome: Outcome) -> str:
    """Put an outcome into a cell."""
    fastest = np.nanmax(outcome.speed) if np.isfinite(outcome.speed).any() else float("nan")
    wrong, lost = np.count_nonzero(outcome.wrong), np.count_nonzero(outcome.lost)
    unseen = np.count_nonzero(outcome.unseen)
    text = f"{wrong} / {lost}{f' + {unseen}' if unseen else ''} ({fastest:.2f}"
    return text + (")" if np.isnan(outcome.recovery) else f", {outcome.recovery:.2f} s)")


def remarks(recorded: Recorded, kind: str, outcome: Outcome) -> list[str]:
    """Name the frames that are wrong or lost, with reasons."""
    lines = []
    if outcome.wrong.any():
        spans = ", ".join(
            f"{_frames(recorded, run)} {outcome.shown[run[0]].fault or 'unbroken'}"
            for run in _runs(outcome.wrong)
        )
        lines.append(f"- {recorded.name}, {kind}: tracked but wrong: {spans}")
    for words, chosen in (
        ("good but lost", outcome.lost),
        ("lost at a place never seen", outcome.unseen),
    ):
        if chosen.any():
            why = Counter(_words(outcome.results[i].reason) for i in np.flatnonzero(chosen))
            spans = ", ".join(_frames(recorded, run) for run in _runs(chosen))
            reasons = "; ".join(f"{reason} ({count})" for reason, count in why.most_common())
            lines.append(f"- {recorded.name}, {kind}: {words}: {spans}: {reasons}")
    return lines


def share(part: int, whole: int) -> str:
    """Write a share with what it is of."""
    return f"{part / whole:.2%} ({part}) of {whole}" if whole else "none of 0"


def _truth(reference: Trajectory, time: float) -> NDArray[np.float64]:
    try:
        return reference.at(time)
    except TrajectoryError:
        return np.full((4, 4), np.nan)


def _status(results: Sequence[TrackedFrame], status: Status) -> NDArray[np.bool_]:
    return np.array([result.status is status for result in results])


def _runs(chosen: NDArray[np.bool_]) -> list[NDArray[np.intp]]:
    indices = np.flatnonzero(chosen)
    return np.split(indices, np.flatnonzero(np.diff(indices) > 1) + 1)


def _frames(recorded: Recorded, run: NDArray[np.intp]) -> str:
    first, last = int(run[0]) + recorded.first, int(run[-1]) + recorded.first
    return f"{first}" if first == last else f"{first}-{last}"


def _words(reason: str) -> str:
    """Reason without its numbers, which differ from frame to frame."""
    return "".join("#" if letter.isdigit() else letter for letter in reason)


if __name__ == "__main__":
    main()
