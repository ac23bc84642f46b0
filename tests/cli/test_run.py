import json
import re
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from edvo.trajectory import Trajectory

from .conftest import Command, position, rows, stamp

COLUMNS = {
    *("timestamp", "status", "iterations", "matches", "inliers", "agreeing", "sigma_px"),
    "track_ms",
}
POSE = ["tx", "ty", "tz", "qx", "qy", "qz", "qw"]


def test_writes_all_that_was_promised(edvo: Command, whole_sequence: Path, tmp_path: Path) -> None:
    out = tmp_path / "new" / "folder"
    done = edvo("run", whole_sequence, "-o", out)
    assert done.status == 0, done.err
    assert {file.name for file in out.iterdir()} == {
        "trajectory.txt",
        "frames.csv",
        "summary.json",
        "config.yaml",
    }
    frames = rows(out)
    assert [row["timestamp"] for row in frames] == [stamp(i) for i in range(36)]
    assert set(frames[0]) >= COLUMNS | set(POSE)
    assert any(name.endswith("_ms") and name != "track_ms" for name in frames[0])
    assert all(row["status"] == "tracked" for row in frames)
    assert all(float(row["track_ms"]) > 0 for row in frames)
    summary = json.loads((out / "summary.json").read_text())
    assert summary["coverage"] == 1.0
    assert summary["frames"]["tracked"] == 36
    assert summary["camera"]["fx"] == 150.0
    assert set(summary["measured"]) == {"depth_delay_s", "readout_s", "exposure_s"}
    assert summary["evaluation"]["rpe"]["pairs"] > 2
    assert yaml.safe_load((out / "config.yaml").read_text()) == summary["config"]


def test_trajectory_is_true_and_keeps_stamps(
    edvo: Command, whole_sequence: Path, tmp_path: Path
) -> None:
    edvo("run", whole_sequence, "-o", tmp_path)
    lines = (tmp_path / "trajectory.txt").read_text().splitlines()
    poses = [line.split() for line in lines if not line.startswith("#")]
    assert [pose[0] for pose in poses] == [stamp(i) for i in range(36)]
    assert all(len(re.sub(r"^[-0.]+|\.", "", pose[1])) >= 9 for pose in poses[1:])
    found = Trajectory.read(tmp_path / "trajectory.txt").poses[:, 0, 3]
    expected = np.array([position(i) for i in range(36)])
    np.testing.assert_allclose(found, expected, atol=0.01)


def test_prints_errors_beside_zero_motion(
    edvo: Command, whole_sequence: Path, tmp_path: Path
) -> None:
    done = edvo("run", whole_sequence, "-o", tmp_path)
    assert "RPE rmse m/s" in done.out
    assert "zero motion" in done.out
    assert "100.0%" in done.out


def test_without_truth_prints_no_errors(edvo: Command, sequence: Path, tmp_path: Path) -> None:
    (sequence / "groundtruth.txt").unlink()
    done = edvo("run", sequence, "-o", tmp_path / "out")
    assert done.status == 0
    assert "RPE" not in done.out
    assert json.loads((tmp_path / "out/summary.json").read_text())["evaluation"] is None


def test_start_stride_and_count(edvo: Command, whole_sequence: Path, tmp_path: Path) -> None:
    done = edvo(
        "run", whole_sequence, "-o", tmp_path, "--start", 3, "--stride", 2, "--max-frames", 5
    )
    assert done.status == 0, done.err
    assert [row["timestamp"] for row in rows(tmp_path)] == [stamp(i) for i in (3, 5, 7, 9, 11)]


def test_start_behind_the_end(edvo: Command, whole_sequence: Path, tmp_path: Path) -> None:
    done = edvo("run", whole_sequence, "-o", tmp_path, "--start", 36)
    assert done.status == 1
    assert done.err.count("\n") == 1
    assert "36" in done.err


def test_same_seed_same_bytes(edvo: Command, whole_sequence: Path, tmp_path: Path) -> None:
    few = ["--set", "sampling.count=60"]
    for name, seed in (("a", 1), ("b", 1), ("c", 2)):
        done = edvo("run", whole_sequence, "-o", tmp_path / name, "--seed", seed, *few)
        assert done.status == 0, done.err
    a, b, c = ((tmp_path / name / "trajectory.txt").read_bytes() for name in "abc")
    assert a == b
    assert a != c


@pytest.mark.parametrize("preset", ["paper", "default"])
def test_written_config_gives_the_same_run(
    edvo: Command, whole_sequence: Path, tmp_path: Path, preset: str
) -> None:
    first, second = tmp_path / "first", tmp_path / "second"
    edvo("run", whole_sequence, "-o", first, "--preset", preset, "--max-frames", 12)
    done = edvo(
        "run", whole_sequence, "-o", second, "--config", first / "config.yaml", "--max-frames", 12
    )
    assert done.status == 0, done.err
    for name in ("trajectory.txt", "config.yaml"):
        assert (first / name).read_bytes() == (second / name).read_bytes()


def test_preset_and_config_exclude_each_other(
    edvo: Command, whole_sequence: Path, tmp_path: Path
) -> None:
    done = edvo(
        "run", whole_sequence, "-o", tmp_path, "--preset", "paper", "--config", tmp_path / "c.yaml"
    )
    assert done.status == 1
    assert "--preset" in done.err


@pytest.mark.parametrize(
    ("option", "named"),
    [
        (["--preset", "fast"], "fast"),
        (["--config", "missing.yaml"], "missing.yaml"),
        (["--set", "no.such=1"], "no"),
        (["--set", "nonsense"], "nonsense"),
        (["--format", "betamax"], "betamax"),
        (["--camera", "missing.yaml"], "missing.yaml"),
    ],
)
def test_wrong_option_is_named_in_one_line(
    edvo: Command, whole_sequence: Path, tmp_path: Path, option: list[str], named: str
) -> None:
    done = edvo("run", whole_sequence, "-o", tmp_path / "out", *option)
    assert done.status == 1
    assert named in done.err
    assert done.err.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_a_mask_leaves_out_what_is_not_of_the_scene(
    edvo: Command, whole_sequence: Path, tmp_path: Path
) -> None:
    width, height = 160, 120
    shown = np.full((height, width), 255, np.uint8)
    shown[:, : width // 2] = 0
    mask = tmp_path / "mask.png"
    cv2.imwrite(str(mask), shown)
    done = edvo("run", whole_sequence, "-o", tmp_path / "out", "--mask", mask)
    assert done.status == 0, done.err
    edvo("run", whole_sequence, "-o", tmp_path / "all")
    fewer, every = (
        sum(int(row["samples"]) for row in rows(tmp_path / name)) for name in ("out", "all")
    )
    assert 0.2 < fewer / every < 0.8
    summaries = [
        json.loads((tmp_path / name / "summary.json").read_text())["source"]
        for name in ("out", "all")
    ]
    assert summaries[0]["mask"] == {"path": str(mask), "left_out": 0.5}
    assert "mask" not in summaries[1]


def test_a_mask_of_another_size(edvo: Command, whole_sequence: Path, tmp_path: Path) -> None:
    mask = tmp_path / "mask.png"
    cv2.imwrite(str(mask), np.eye(30, dtype=np.uint8))
    done = edvo("run", whole_sequence, "-o", tmp_path / "out", "--mask", mask)
    assert done.status == 1
    assert done.err.splitlines()[-1].endswith("give one of their size")
    assert not (tmp_path / "out").exists()
