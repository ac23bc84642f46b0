"""Whether `edvo run` keeps both cores busy while it decodes and tracks."""

import json
import time
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

from benchmarks.edvo_program import edvo, folder_of
from benchmarks.machine import Others
from benchmarks.section import Bound, Section, Settings, table
from edvo.config import Config
from edvo.cores import usable_cores
from edvo.datasets import open_source
from edvo.frame import Frame
from edvo.odometry import Odometry

LIMIT = 1.35


def measure(settings: Settings) -> Section:
    """Compare wall time of the run with the processor time of its two parts."""
    repeats = settings.choose(2, 5)
    rows, bounds = [], []
    for recording in settings.recordings:
        with folder_of(recording) as folder, TemporaryDirectory() as out:
            others = Others()
            walls = [_wall(folder, Path(out)) for _ in range(repeats + 1)][1:]
            share = others.share()
            spent = [_processor(folder) for _ in range(repeats)]
        decode, track = (median(part) for part in zip(*spent, strict=True))
        wall = median(walls)
        ratio = wall / ((decode + track) / 2)
        rows.append(
            [
                recording.name,
                f"{decode:.3f}",
                f"{track:.3f}",
                f"{wall:.3f}",
                f"**{ratio:.2f}**",
                f"{min(walls):.3f}-{max(walls):.3f}",
                share,
            ]
        )
        bounds.append(
            Bound(f"edvo run, wall / half of processor time, {recording.name}", LIMIT, ratio)
        )
    header = ["sequence", "decoding, CPU s", "tracking, CPU s", "edvo run, wall s"]
    header += ["wall / half of CPU", "wall, least and most", "cores taken by others"]
    body = (
        "All frames of each sequence, preset `paper`. Processor time: of one thread that does "
        f"nothing else, median of {repeats} passes over all images, and over all `track` calls. "
        "Wall time: `wall_s` of `summary.json`, from the first image asked for to the last frame "
        f"tracked, median of {repeats} runs of the command. This process may use {usable_cores()} "
        "cores; half of the processor time is what two could do it in, were nobody else "
        "there.\n\n" + table(header, rows)
    )
    return Section("Both cores", body, bounds)


def _wall(folder: Path, out: Path) -> float:
    edvo("run", folder, "-o", out, "--preset", "paper")
    wall = json.loads((out / "summary.json").read_text(encoding="utf-8"))["wall_s"]
    return float(wall)


def _processor(folder: Path) -> tuple[float, float]:
    """Processor seconds of decoding and of tracking, one after the other on this thread."""
    source = open_source(folder)
    begin = time.thread_time()
    readings = [source.read(index) for index in range(len(source))]
    decode = time.thread_time() - begin
    frames: list[Frame] = [reading.frame for reading in readings if reading.frame is not None]
    odometry = Odometry(source.camera, Config.preset("paper"))
    begin = time.thread_time()
    for frame in frames:
        odometry.track(frame)
    return decode, time.thread_time() - begin
