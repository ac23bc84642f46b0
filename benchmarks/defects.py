"""Images as cameras and recorders spoil them: noise, compression, a black rim, dirt, specks.

    python -m benchmarks.defects [--docs]

spoils the real sequences that `EDVO_DATA` names, and two rendered ones, and tracks each from two
first frames: the preset `default`, the same without what it makes of such images, and two others
of `edvo compare`. Printed are root mean squares of the relative pose error over one second (TUM),
and the share of the frames that have a pose, and of edvo those that say *tracked*.
"""

import argparse
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.frames import ROOT, Recording, available, recording
from benchmarks.report import document
from benchmarks.section import table
from edvo.baselines.registry import Tracker, make_tracker
from edvo.camera import Camera
from edvo.config import Config
from edvo.errors import EvaluationError
from edvo.evaluation import evaluate
from edvo.frame import Frame
from edvo.odometry import Odometry, Status

PAGE = ROOT / "docs" / "theory" / "images.md"
MARK = "<!-- measured: written by python -m benchmarks.defects --docs -->\n"
RENDERED, FRAMES = ("stairs", "notexture_far"), 130
STARTS = (0, 12)
AS_IT_IS = (
    "edges.max_noise=0",
    "edges.max_blockiness=1e9",
    "edges.black_rim=kept",
    "edges.carried=kept",
    "edges.bands=kept",
    "edges.strays=kept",
    "planes.lead=none",
)
RIM_PX = 25
MAINS_HZ, READOUT_S, LIT = 100.0, 0.03, 0.35  # of a lamp, and by what share of its light
SWITCHED_HZ, EXPOSED_S = 120.0, 0.002  # of one that is switched on and off
JUMPS_HZ, JUMP = 4.0, 0.35  # of a gain: its logarithm (one sigma)
SPECKS, SPECK_PX, NEAREST_SPECK = 200, 5, 0.1  # at most, to a side; of the right depth, at least
PRINT = "2026-11-27 12:00 CAM 1"

Grey = NDArray[np.uint8]
Spoil = Callable[[Frame, np.random.Generator], Frame]


def noise(sigma: float) -> Spoil:
    """Add white noise, in grey levels."""

    def spoil(frame: Frame, random: np.random.Generator) -> Frame:
        return replace(frame, grey=_noisy(frame.grey, sigma, random))

    return spoil


def bayer(sigma: float) -> Spoil:
    """Add white noise to what lies behind a Bayer pattern, which smooths it."""

    def spoil(frame: Frame, random: np.random.Generator) -> Frame:
        raw = _noisy(frame.grey, sigma, random)
        colours = cv2.cvtColor(raw, cv2.COLOR_BayerBG2BGR)
        return replace(frame, grey=np.asarray(cv2.cvtColor(colours, cv2.COLOR_BGR2GRAY), np.uint8))

    return spoil


def jpeg(quality: int) -> Spoil:
    """Compress."""

    def spoil(frame: Frame, _: np.random.Generator) -> Frame:
        data = cv2.imencode(".jpg", frame.grey, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
        return replace(frame, grey=np.asarray(cv2.imdecode(data, cv2.IMREAD_GRAYSCALE), np.uint8))

    return spoil


def rim(frame: Frame, _: np.random.Generator) -> Frame:
    """Leave nothing of colour and depth near the border."""
    inside = np.zeros(frame.grey.shape, bool)
    inside[RIM_PX:-RIM_PX, RIM_PX:-RIM_PX] = True
    grey, depth = np.where(inside, frame.grey, 0), np.where(inside, frame.depth, 0)
    return replace(frame, grey=grey.astype(np.uint8), depth=depth.astype(np.float32))


def printed(frame: Frame, _: np.random.Generator) -> Frame:
    """Print four lines across the image, as recorders print the time."""
    grey, height = frame.grey.copy(), frame.grey.shape[0]
    for line in range(4):
        at = 10, height // 5 + line * height // 5
        cv2.putText(grey, PRINT, at, cv2.FONT_HERSHEY_SIMPLEX, 1.2, 255, 3)
    return replace(frame, grey=grey)


def scratches(frame: Frame, _: np.random.Generator) -> Frame:
    """Look through a window with ten scratches that light up."""
    random, veil = np.random.default_rng(4), np.zeros(frame.grey.shape, np.float32)
    for ends in (random.random((10, 2, 2)) * frame.grey.shape[::-1]).astype(int):
        cv2.line(veil, *ends.tolist(), 60.0, 2)
    lit = frame.grey + cv2.GaussianBlur(veil, (0, 0), 2)
    return replace(frame, grey=np.clip(lit, 0, 255).astype(np.uint8))


def dirt(frame: Frame, _: np.random.Generator) -> Frame:
    """Look past spots over a twelfth of the image that take three fifths of the light."""
    height, width = frame.grey.shape
    coarse = np.random.default_rng(3).normal(size=(height // 20 + 2, width // 20 + 2))
    smooth = cv2.resize(coarse.astype(np.float32), (width, height), interpolation=cv2.INTER_CUBIC)
    spots = (smooth < np.quantile(smooth, 0.08)).astype(np.float32)
    dark = frame.grey * (1 - 0.6 * cv2.GaussianBlur(spots, (0, 0), 3))
    return replace(frame, grey=dark.astype(np.uint8))


def bands(frame: Frame, _: np.random.Generator) -> Frame:
    """Light it by a lamp on the mains while its rows are read, one after the other."""
    return _lit(frame, 1 + LIT * np.sin(2 * np.pi * MAINS_HZ * _instants(frame)))


def switched(frame: Frame, _: np.random.Generator) -> Frame:
    """Light it by a lamp that is switched on and off, more often than it is seen to be."""
    exposed = _instants(frame)[:, None] + np.linspace(0, EXPOSED_S, 25)
    return _lit(frame, 1 + LIT * (1 - 2 * (SWITCHED_HZ * exposed % 1 < 0.5).mean(axis=1)))


def gain(frame: Frame, _: np.random.Generator) -> Frame:
    """Take it by a gain that jumps."""
    random = np.random.default_rng(int(JUMPS_HZ * frame.timestamp))
    return _lit(frame, np.full(len(frame.grey), np.exp(random.normal(0, JUMP))))


def specks(frame: Frame, random: np.random.Generator) -> Frame:
    """Put discs of depth where no surface is, as a stereo camera does that matches wrongly."""
    return replace(frame, depth=speckled(frame.depth, random))


def speckled(depth: NDArray[np.float32], random: np.random.Generator) -> NDArray[np.float32]:
    """Put these discs into a depth image, metres."""
    depth = depth.copy()
    height, width = depth.shape
    for u, v in random.integers((width, height), size=(SPECKS, 2)).tolist():
        z = float(depth[v, u]) or float(np.median(depth[depth > 0]))
        radius = int(random.integers(1, SPECK_PX + 1))
        cv2.circle(depth, (u, v), radius, z * random.uniform(NEAREST_SPECK, 1), -1)
    return depth


def _instants(frame: Frame) -> NDArray[np.float64]:
    """When each row is read, seconds."""
    rows = len(frame.grey)
    return frame.timestamp + READOUT_S * np.arange(rows) / rows


def _lit(frame: Frame, rows: NDArray[np.float64]) -> Frame:
    """Multiply the light of each row; what is then too bright is white."""
    lit = np.clip(frame.grey * rows[:, None], 0, 255)
    return replace(frame, grey=lit.astype(np.uint8))


DEFECTS: dict[str, Spoil] = {
    "none": lambda frame, _: frame,
    "noise, 5 grey levels": noise(5),
    "noise, 10": noise(10),
    "noise, 20": noise(20),
    "noise, 10 behind a Bayer pattern": bayer(10),
    "JPEG, quality 80": jpeg(80),
    "JPEG, quality 40": jpeg(40),
    f"black rim, {RIM_PX} px": rim,
    "print, four lines": printed,
    "scratches on a window": scratches,
    "dirt on the lens": dirt,
    "a lamp on the mains, row by row": bands,
    "a lamp that is switched, row by row": switched,
    "gain that jumps four times a second": gain,
    f"depth: {SPECKS} specks": specks,
}


def main() -> None:
    """Print a table a sequence."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--docs", action="store_true", help="put the tables into docs/ as well")
    given = parser.parse_args()
    cv2.setNumThreads(1)
    makers = contestants("image as it is", AS_IT_IS)
    text = ""
    for name in dict.fromkeys((*available(), *RENDERED)):
        whole, rows = recording(name, FRAMES), []
        for defect, spoil in DEFECTS.items():
            random = np.random.default_rng(1)
            spoiled = replace(whole, frames=tuple(spoil(each, random) for each in whole.frames))
            rows.append([defect, *(score(spoiled, make) for make in makers.values())])
            print(f"{name} | " + " | ".join(rows[-1]), flush=True)
        text += f"### {name}\n\n" + table(["defect", *makers], rows) + "\n\n"
    print("\n" + text)
    if given.docs:
        document(PAGE.parent, text.rstrip() + "\n", page=PAGE, mark=MARK)


def contestants(name: str, changes: Sequence[str]) -> dict[str, Callable[[Camera], Tracker]]:
    """Give the preset `default`, the same with changes, by this name, and two others."""
    return {
        "default": Odometry,
        name: lambda camera: Odometry(camera, Config().with_overrides(changes)),
        "OpenCV RGB-D": lambda camera: make_tracker("opencv-rgbd", camera),
        "ORB with PnP": lambda camera: make_tracker("orb-pnp", camera),
    }


def score(recorded: Recording, make: Callable[[Camera], Tracker]) -> str:
    """Track a sequence from each first frame: error in mm/s, and how many frames have a pose."""
    squares: list[float] = []
    posed = tracked = every = 0
    for start in STARTS:
        frames, tracker = recorded.frames[start:], make(recorded.camera)
        statuses = [tracker.track(frame).status for frame in frames]
        posed += sum(status is not Status.LOST for status in statuses)
        tracked += sum(status is Status.TRACKED for status in statuses)
        every += len(frames)
        squares += list(_squares(recorded, tracker, len(frames)))
    error = 1e3 * float(np.sqrt(np.mean(squares))) if squares else np.inf
    shares = f"{100 * posed / every:.0f} %"
    if isinstance(tracker, Odometry):
        shares += f", {100 * tracked / every:.0f} %"
    return f"{error:.{1 if error < 100 else 0}f}; {shares}" if squares else f"lost; {shares}"


def _squares(recorded: Recording, tracker: Tracker, count: int) -> Iterator[float]:
    """Give the squared error of a run; nothing where too little has a pose."""
    truth = recorded.source.ground_truth
    assert truth is not None
    try:
        found = evaluate(truth, tracker.trajectory, count).rpe
    except EvaluationError:
        return
    if found is not None:
        yield found.rmse**2


def _noisy(grey: Grey, sigma: float, random: np.random.Generator) -> Grey:
    noisy: Grey = np.clip(np.rint(grey + random.normal(0, sigma, grey.shape)), 0, 255).astype(
        np.uint8
    )
    return noisy


if __name__ == "__main__":
    main()
