"""`Odometry.track` against the edge detector alone, and against OpenCV's RGB-D odometry.

Everything runs on one thread, on the same frames, interleaved frame by frame in random order, so
that what disturbs the machine disturbs all alike, and a cold cache hits each as often.
"""

import random
import time
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from benchmarks.frames import Recording
from benchmarks.peers import EdgeDetector, OpenCvOdometry
from benchmarks.section import Bound, Section, Settings, ms, table
from edvo.config import PRESETS, Config
from edvo.frame import Frame
from edvo.odometry import Odometry

# Times the edge detector at most, by preset: what must be kept, and what is hoped for
MUST = {"paper": {"": 3.5, " (stretch)": 2.5}, "default": {"": 5.0}}
HITCH, TENTH = 2.0, 0.1  # one frame in a hundred over the median; track over cv2.Odometry
Call = Callable[[Frame], object]


def interleave(
    frames: Sequence[Frame], make: Callable[[], Mapping[str, Call]], repeats: int
) -> dict[str, NDArray[np.float64]]:
    """Time several calls on each frame in turn.

    Parameters
    ----------
    frames : sequence of Frame
    make : callable
        Makes the calls anew for each repetition: they keep state from frame to frame.
    repeats : int
        After one more that is not counted.

    Returns
    -------
    dict of str to ndarray, shape (repeats, F - 1)
        Seconds; the first frame is left out, since nothing is registered there.
    """
    rng = random.Random(0)
    names = list(make())
    seconds = {name: np.empty((repeats + 1, len(frames))) for name in names}
    for repeat in range(repeats + 1):
        calls = make()
        for index, frame in enumerate(frames):
            for name in rng.sample(names, len(names)):
                call = calls[name]
                begin = time.perf_counter()
                call(frame)
                seconds[name][repeat, index] = time.perf_counter() - begin
    return {name: values[1:, 1:] for name, values in seconds.items()}


def measure(settings: Settings) -> Section:
    """Make both tables."""
    detector, detector_bounds = against_detector(settings)
    peer, peer_bounds = against_opencv(settings)
    return Section(
        "Track against its peers", f"{detector}\n\n{peer}", detector_bounds + peer_bounds
    )


def against_detector(settings: Settings) -> tuple[str, list[Bound]]:
    """Compare each preset with blur, Sobel and Canny at its thresholds."""
    repeats = settings.choose(2, 9)
    rows, bounds = [], []
    for recording in settings.recordings:
        for preset in PRESETS:
            config = Config.preset(preset)
            times = interleave(recording.frames, _detector_and_track(recording, config), repeats)
            track, detector = times["track"], times["detector"]
            each = np.median(track, axis=0) / np.median(detector, axis=0)
            runs = np.median(track / detector, axis=1)
            ratio = float(np.median(each))
            hitch = float(np.median(np.percentile(track, 99, axis=1) / np.median(track, axis=1)))
            rows.append(
                [
                    recording.name,
                    preset,
                    ms(float(np.median(detector))),
                    ms(float(np.median(track))),
                    f"**{ratio:.2f}**",
                    f"{np.median(track) / np.median(detector):.2f}",
                    f"{np.percentile(each, 95):.2f}",
                    f"{hitch:.2f}",
                    f"{runs.min():.2f}-{runs.max():.2f}",
                ]
            )
            what = f"{recording.name}, {preset}"
            for hope, most in MUST[preset].items():
                bounds.append(Bound(f"track / edge detector, {what}{hope}", most, ratio))
            bounds.append(Bound(f"99th percentile / median of track, {what}", HITCH, hitch))
    header = ["sequence", "preset", "edge detector, ms", "track, ms", "median of the ratios"]
    header += ["ratio of the medians", "95 % of frames below"]
    header += ["99th percentile / median", f"spread over {repeats} runs"]
    return (
        "The edge detector is a 5x5 `cv2.GaussianBlur`, two 16-bit `cv2.Sobel` and `cv2.Canny` on "
        "their result, at the thresholds of the preset; grey conversion and undistortion are left "
        "out of both. A ratio is that of one frame, each time the median over the runs; the 99th "
        "percentile is that of each run by itself, over its median, in the median of the runs.\n\n"
        + table(header, rows)
    ), bounds


def against_opencv(settings: Settings) -> tuple[str, list[Bound]]:
    """Compare the paper preset with ``cv2.Odometry``."""
    repeats, count = settings.choose(1, 3), settings.choose(10, 60)
    rows, bounds = [], []
    for recording in settings.recordings:

        def make(recording: Recording = recording) -> dict[str, Call]:
            return {
                "track": Odometry(recording.camera, Config.preset("paper")).track,
                "opencv": OpenCvOdometry(recording.camera).track,
            }

        times = interleave(recording.frames[:count], make, repeats)
        track, peer = times["track"], times["opencv"]
        ratio = float(np.median(np.median(track, axis=0) / np.median(peer, axis=0)))
        rows.append(
            [
                recording.name,
                ms(float(np.median(peer))),
                ms(float(np.median(track))),
                f"**{ratio:.3f}**",
                f"{1 / ratio:.0f} times",
            ]
        )
        bounds.append(Bound(f"track / cv2.Odometry, {recording.name}", TENTH, ratio))
    header = ["sequence", "cv2.Odometry, ms", "track, ms", "median of the ratios", "faster"]
    return (
        "`cv2.Odometry` (RGB-D, its own settings) goes from frame to frame; its time is "
        "`prepareFrame` of the new frame and `compute`. Preset `paper`.\n\n" + table(header, rows)
    ), bounds


def _detector_and_track(recording: Recording, config: Config) -> Callable[[], dict[str, Call]]:
    def make() -> dict[str, Call]:
        return {
            "track": Odometry(recording.camera, config).track,
            "detector": EdgeDetector(recording.camera, config.edges).detect,
        }

    return make
