"""The page of runs that are long, interrupted, or nothing but lost."""

import json
import re
from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest

from edvo.config import Config
from edvo.datasets import Source
from edvo.export.edge_map import EdgePoints
from edvo.odometry import Odometry, Status
from edvo.report.run_page import changes, page
from edvo.report.run_path import path_of
from edvo.report.run_plots import mean_stages
from edvo.report.tracking import FrameRecord, Registration, Run
from edvo.report.watch import Watch

from .fakes import CAMERA, FakeSource

NO_EDGES = EdgePoints(
    np.empty((0, 3)), np.empty((0, 2)), np.empty(0, np.uint8), np.empty(0, np.int64)
)


def record(index: int, status: Status = Status.TRACKED, **more: Any) -> FrameRecord:
    T_world_cam = np.eye(4)
    T_world_cam[:3, 3] = np.cos(index / 1000), 0.1, index / 1000
    made = FrameRecord(
        stamp=f"{index / 10:.6f}",
        timestamp=index / 10,
        status=status,
        reason="" if status is Status.TRACKED else f"reason {index}",
        T_world_cam=T_world_cam,
        keyframe=0,
        is_keyframe=index % 10 == 0,
        edges=1000,
        samples=100,
        registration=Registration(5, 100, 90, 80, 0.5, 0, 0.0, 0.0),
        track_s=0.002,
        stages={"edges": 0.001},
        problem=None,
    )
    return replace(made, **more)


def page_of(frames: list[FrameRecord], *, wanted: int = 0, edges: EdgePoints = NO_EDGES) -> str:
    source = cast(Source, FakeSource(4, truth=False))
    run = Run(source, frames, wanted or len(frames), 1.0)
    watch = Watch(Odometry(CAMERA), len(frames))
    return page(run, Config(), None, watch, edges, ["a < b"])


def test_page_of_a_long_run_is_no_larger() -> None:
    lost = set(range(5000, 5100)) | set(range(100, 20_000, 400))
    frames = [
        record(i, Status.LOST) if i in lost else record(i, Status.TRACKED) for i in range(20_000)
    ]
    many = 100_000
    rng = np.random.default_rng(0)
    edges = EdgePoints(
        rng.normal(size=(many, 3)),
        rng.normal(size=(many, 2)),
        np.zeros(many, np.uint8),
        np.ones(many, np.int64),
    )
    text = page_of(frames, edges=edges)
    assert len(text) < 2_000_000
    assert "more; frames.csv names each" in text
    assert "reason 5000" in text
    assert "reason 5001" not in text
    data = json.loads(re.search(r'id="path-data">(.*?)</script>', text, re.DOTALL)[1])
    assert len(data["estimate"]) <= 8000
    assert len(data["keyframes"]) <= 300


def test_short_losses_part_the_line_of_a_long_run() -> None:
    """One frame in 20,000 falls between those that are drawn."""
    frames = [record(i, Status.LOST if i == 10_001 else Status.TRACKED) for i in range(20_000)]
    text = page_of(frames)
    data = json.loads(re.search(r'id="path-data">(.*?)</script>', text, re.DOTALL)[1])
    assert None in data["estimate"]


def test_interrupted_and_warned() -> None:
    text = page_of([record(i) for i in range(3)], wanted=50)
    assert "interrupted after 3 of 50 frames" in text
    assert "a &lt; b" in text


@pytest.mark.parametrize("count", [1, 2])
def test_very_short_runs(count: int) -> None:
    text = page_of([record(i) for i in range(count)])
    assert f"tracked in all {count} frames" in text


def test_nothing_was_readable() -> None:
    nothing = {"registration": None, "track_s": None, "stages": {}, "problem": "broken"}
    text = page_of([record(i, Status.LOST, **nothing) for i in range(3)])
    assert "lost throughout" in text
    assert 'id="times"' not in text


def test_path_leaves_out_what_is_lost() -> None:
    frames = [record(0), record(1, Status.LOST), record(2, Status.DEGRADED)]
    path = path_of(Run(cast(Source, FakeSource(3)), frames, 3, 1.0), None)
    assert path is not None
    assert np.isnan(path.places[1]).all()
    assert path.ranks.tolist() == [0, 2, 1]
    assert path_of(Run(cast(Source, FakeSource(3)), [frames[1]], 1, 1.0), None) is None


def test_stages_and_the_rest_make_the_whole() -> None:
    frames = [record(0), record(1, stages={"edges": 0.001, "search": 0.0006})]
    means = mean_stages(frames)
    assert means == pytest.approx({"edges": 1.0, "search": 0.3, "other": 0.7})


def test_changes_are_those_to_the_preset() -> None:
    assert changes(Config()) == []
    assert changes(Config.preset("paper")) == []
    changed = Config().with_overrides(["seed=3", "sampling.count=77"])
    found = changes(changed)
    assert [line.split(" ")[0] for line in found] == ["seed=3", "sampling.count=77"]
