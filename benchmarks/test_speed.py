"""Stages and whole calls by pytest-benchmark: ``python -m pytest benchmarks``.

Frames go back and forth, so that any number of rounds sees smooth motion. OpenCV runs on one
thread, as everything else does.
"""

from collections.abc import Iterator
from itertools import cycle

import cv2
import pytest
from pytest_benchmark.fixture import BenchmarkFixture

from benchmarks.frames import DATA, REAL, Recording, available, recording
from benchmarks.peers import EdgeDetector, OpenCvOdometry
from benchmarks.replay import catch
from edvo.config import PRESETS, Config
from edvo.edges import extract_edges
from edvo.matching import EdgeIndex, Method
from edvo.odometry import Odometry
from edvo.sampling import sample_edges

COUNT = 40
PAPER = Config.preset("paper")


@pytest.fixture(scope="module", params=sorted({*REAL, *available()}))
def frames(request: pytest.FixtureRequest) -> Recording:
    """Each real sequence; one that is not there is skipped, and said so."""
    name: str = request.param
    if name in REAL and not (DATA / name).is_dir():
        pytest.skip(f"{name} is not there: set EDVO_DATA to a folder of TUM sequences")
    return recording(name, COUNT)


@pytest.fixture(autouse=True)
def _one_thread() -> Iterator[None]:
    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    yield
    cv2.setNumThreads(before)


def test_edge_detector(benchmark: BenchmarkFixture, frames: Recording) -> None:
    turn = cycle(frames.frames)
    detector = EdgeDetector(frames.camera, PAPER.edges)
    benchmark(lambda: detector.detect(next(turn)))


def test_edges(benchmark: BenchmarkFixture, frames: Recording) -> None:
    turn = cycle(frames.frames)
    benchmark(lambda: extract_edges(next(turn).grey, PAPER.edges))


def test_sampling(benchmark: BenchmarkFixture, frames: Recording) -> None:
    turn = cycle([(extract_edges(frame.grey, PAPER.edges), frame) for frame in frames.frames])

    def draw() -> None:
        edges, frame = next(turn)
        sample_edges(edges, frame.depth, frames.camera, PAPER.sampling, PAPER.edges, 0)

    benchmark(draw)


@pytest.mark.parametrize("method", ["grid", "tree"])
def test_index(benchmark: BenchmarkFixture, frames: Recording, method: Method) -> None:
    edges = extract_edges(frames.frames[0].grey, PAPER.edges).describe(frames.camera)
    benchmark(lambda: EdgeIndex(edges, method))


def test_registration(benchmark: BenchmarkFixture, frames: Recording) -> None:
    turn = cycle(catch(frames, PAPER, COUNT).registrations)
    benchmark(lambda: next(turn).align())


@pytest.mark.parametrize("preset", PRESETS)
def test_track(benchmark: BenchmarkFixture, frames: Recording, preset: str) -> None:
    turn = frames.endless()
    odometry = Odometry(frames.camera, Config.preset(preset))
    odometry.track(next(turn))

    def frame() -> tuple[tuple[object], dict[str, object]]:
        return (next(turn),), {}  # made outside the time that counts

    benchmark.pedantic(odometry.track, setup=frame, rounds=200, warmup_rounds=5)


def test_opencv_odometry(benchmark: BenchmarkFixture, frames: Recording) -> None:
    turn = frames.endless()
    odometry = OpenCvOdometry(frames.camera)
    odometry.track(next(turn))

    def frame() -> tuple[tuple[object], dict[str, object]]:
        return (next(turn),), {}

    benchmark.pedantic(odometry.track, setup=frame, rounds=15, warmup_rounds=1)
