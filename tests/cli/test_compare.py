"""`edvo compare` as a user runs it."""

import csv
import importlib.util
import json
import shutil
import signal
from pathlib import Path
from typing import Any
from unittest.mock import patch

import pytest

from edvo.baselines import registry
from edvo.cli import compare as compare_module
from edvo.errors import MissingExtraError
from edvo.report.compare_rank import ordinal
from edvo.trajectory import Trajectory

from .conftest import Command, full_disk, interrupted

SMALL_CAMERA = """width: 80
height: 60
fx: 66.9
fy: 67.4
cx: 39.6
cy: 30.6
depth_scale: 5000
"""
FILES = {"compare.md", "compare.csv", "compare.json", "trajectories"}


def read(folder: Path) -> dict[str, Any]:
    whole: dict[str, Any] = json.loads((folder / "compare.json").read_text())
    return whole


def rows(folder: Path, sequence: int = 0) -> dict[str, dict[str, Any]]:
    return {row["system"]: row for row in read(folder)["sequences"][sequence]["rows"]}


def one_line(error: str) -> bool:
    return error.startswith("edvo: ") and error.count("\n") == 1


def test_stamps_that_are_no_seconds_are_told_of(edvo: Command, sequence: Path) -> None:
    assert "stamps" not in edvo("compare", sequence, "--max-frames", 2).err
    for name in ("rgb.txt", "depth.txt", "groundtruth.txt"):
        rows = [row.split(" ", 1) for row in (sequence / name).read_text().splitlines()]
        text = [f"{1e3 * float(t):.3f} {rest}\n" for t, rest in rows if t != "#"]
        (sequence / name).write_text("".join(text))
    told = edvo("compare", sequence, "--max-frames", 2).err
    assert f"warning: {sequence.name}: " in told
    assert "stamps look like milliseconds" in told


def test_both_presets_and_who_is_named(edvo: Command, whole_sequence: Path, tmp_path: Path) -> None:
    outcome = edvo(
        "compare", whole_sequence, "--with", "opencv-rgbd,opencv-rgb-f2f", "-o", tmp_path
    )
    assert outcome.status == 0, outcome.err
    lines = outcome.out.splitlines()
    assert lines[0] == "wall: 36 frames"
    names = [line.split()[0] for line in lines[3:8]]
    assert names == ["edvo-default", "edvo-paper", "opencv-rgbd", "opencv-rgb-f2f", "zero-motion"]
    assert any(line.startswith("edvo-default: ") and " of 4 in RPE; " in line for line in lines)
    assert any(line.startswith("edvo-paper: ") and "opencv-rgbd" in line for line in lines)

    assert {file.name for file in tmp_path.iterdir()} == FILES | {
        "wall-paths.png",
        "wall-errors.png",
    }
    found = rows(tmp_path)
    assert list(found) == names
    assert found["edvo-default"]["rpe_rmse_m_s"] < found["zero-motion"]["rpe_rmse_m_s"]
    assert found["opencv-rgbd"]["time_ratio"] > 0
    shown = lines[3].split()
    assert float(shown[2]) == round(found["edvo-default"]["rpe_rmse_m_s"], 4)
    with (tmp_path / "compare.csv").open() as stream:
        assert [line["system"] for line in csv.DictReader(stream)] == names
    tracked = Trajectory.read(tmp_path / "trajectories/wall/edvo-default.txt")
    assert tracked.stamps[1] == "1000.0500"  # as the source writes it
    page = (tmp_path / "compare.md").read_text()
    assert f"edvo compare {whole_sequence}" in page
    assert "(wall-paths.png)" in page


def test_its_errors_are_those_of_edvo_run(
    edvo: Command, whole_sequence: Path, tmp_path: Path
) -> None:
    assert edvo("run", whole_sequence, "-o", tmp_path / "run", "--seed", 3).status == 0
    outcome = edvo(
        "compare", whole_sequence, "--seed", 3, "-o", tmp_path / "compare", "--with", "zero-motion"
    )
    assert outcome.status == 0, outcome.err
    alone = json.loads((tmp_path / "run/summary.json").read_text())["evaluation"]
    row = rows(tmp_path / "compare")["edvo-default"]
    assert row["rpe_rmse_m_s"] == alone["rpe"]["translation_m"]["rmse"]
    assert row["rpe_sturm_rmse_m_s"] == alone["rpe_sturm"]["translation_m"]["rmse"]
    assert row["ate_rmse_m"] == alone["ate"]["translation_m"]["rmse"]
    assert (tmp_path / "run/trajectory.txt").read_text() == (
        tmp_path / "compare/trajectories/wall/edvo-default.txt"
    ).read_text()


def test_without_names_it_is_compared_with_opencv(edvo: Command, whole_sequence: Path) -> None:
    outcome = edvo("compare", whole_sequence, "--max-frames", 5)
    assert outcome.status == 0, outcome.err
    assert "opencv-rgbd" in outcome.out
    assert "opencv-rgb " in outcome.out


def test_frames_chosen(edvo: Command, whole_sequence: Path, tmp_path: Path) -> None:
    outcome = edvo(
        *("compare", whole_sequence, "--with", "zero-motion", "-o", tmp_path),
        *("--start", 4, "--stride", 3, "--max-frames", 9),
    )
    assert outcome.status == 0, outcome.err
    assert rows(tmp_path)["edvo-paper"]["frames"] == 9
    tracked = Trajectory.read(tmp_path / "trajectories/wall/edvo-paper.txt")
    assert tracked.stamps[:2] == ("1000.2000", "1000.3500")


def test_several_sequences_and_what_is_none(
    edvo: Command, whole_sequence: Path, tmp_path: Path
) -> None:
    data = tmp_path / "data"
    for name in ("a", "b"):
        shutil.copytree(whole_sequence, data / name / "wall")
    (data / "README.md").write_text("about\n")
    outcome = edvo(
        *("compare", data / "a", data / "README.md", data / "b/wall"),
        *("--with", "zero-motion", "-o", tmp_path / "out"),
    )
    assert outcome.status == 0, outcome.err
    (line,) = (line for line in outcome.err.splitlines() if "the machine is busy" not in line)
    assert "README.md: no known recording; left out" in line
    # Of the same name, but told apart.
    assert [s["name"] for s in read(tmp_path / "out")["sequences"]] == ["wall", "wall-2"]
    assert (tmp_path / "out/wall-2-paths.png").exists()
    assert "edvo-default: 1st in " in outcome.out
    assert " of 2 sequences by RPE" in outcome.out


def test_a_scene_needs_no_data(edvo: Command, tmp_path: Path) -> None:
    (tmp_path / "small.yaml").write_text(SMALL_CAMERA)
    outcome = edvo(
        *("compare", "synth:texture_near", "--camera", tmp_path / "small.yaml"),
        *("--max-frames", 34, "--with", "opencv-rgbd", "--light", "ambient", "--severity", 0.3),
        *("-o", tmp_path / "out"),
    )
    assert outcome.status == 0, outcome.err
    assert outcome.out.startswith("texture_near+ambient: 34 frames\n")
    assert rows(tmp_path / "out")["zero-motion"]["rpe_rmse_m_s"] > 0
    assert (tmp_path / "out/texture_near+ambient-errors.png").exists()


def test_poses_made_elsewhere(edvo: Command, whole_sequence: Path, tmp_path: Path) -> None:
    truth = Trajectory.read(whole_sequence / "groundtruth.txt")
    truth.write(tmp_path / "wall.txt")
    late = Trajectory.from_poses(truth.timestamps + 5e8, truth.poses)
    late.write(tmp_path / "late.txt")
    Trajectory.from_poses(truth.timestamps[:9], truth.poses[:9]).write(tmp_path / "few.txt")
    outcome = edvo(
        *("compare", whole_sequence, "-o", tmp_path / "out"),
        *("--trajectory", f"perfect={tmp_path}/{{name}}.txt"),
        *("--trajectory", f"late={tmp_path}/late.txt"),
        *("--trajectory", f"few={tmp_path}/few.txt"),
    )
    assert outcome.status == 0, outcome.err
    found = rows(tmp_path / "out")
    assert "opencv-rgbd" not in found  # nobody else is asked for
    assert found["perfect"]["rank"] == 1
    assert found["perfect"]["rpe_rmse_m_s"] < 1e-6
    assert found["perfect"]["wall_ms_median"] is None
    assert found["late"]["failure"].startswith("no pose within 20 ms of a frame")
    assert found["few"]["failure"] == "poses for 25% of the frames only"
    (line,) = (line for line in outcome.out.splitlines() if line.startswith("late "))
    assert " x " in line
    place = ordinal(found["edvo-default"]["rank"])
    assert f"edvo-default: {place} of 5 in RPE" in outcome.out


def test_variants(edvo: Command, whole_sequence: Path, tmp_path: Path) -> None:
    some = ("samples: 250", "keyframe: every 5 frames")
    variants = {k: v for k, v in compare_module.variants_of("default").items() if k in some}
    with patch("edvo.report.compare_systems.variants_of", lambda preset: variants):
        outcome = edvo(
            *("compare", whole_sequence, "--variants", "--preset", "default"),
            *("--repeats", 3, "-o", tmp_path),
        )
    assert outcome.status == 0, outcome.err
    found = rows(tmp_path)
    assert list(found) == ["edvo-default", *some, "edvo-paper", "zero-motion"]
    assert found["edvo-default"]["error_ratio"] == 1.0
    assert found["samples: 250"]["error_ratio"] > 0
    assert [run["begin"] for run in found["samples: 250"]["runs"]] == [0, 3, 6]
    assert "edvo-default: " in outcome.out
    assert "of 2 changes lower the error" in outcome.out
    assert (tmp_path / "trajectories/wall/samples-250.txt").exists()


def test_repeats_are_for_what_draws(edvo: Command, whole_sequence: Path, tmp_path: Path) -> None:
    outcome = edvo(
        *("compare", whole_sequence, "--with", "opencv-rgbd", "--repeats", 3, "--seed", 4),
        *("-o", tmp_path),
    )
    assert outcome.status == 0, outcome.err
    found = rows(tmp_path)
    assert [run["seed"] for run in found["edvo-paper"]["runs"]] == [4, 5, 6]
    assert found["opencv-rgbd"]["runs_done"] == 1
    errors = sorted(run["rpe_rmse_m_s"] for run in found["edvo-paper"]["runs"])
    assert found["edvo-paper"]["rpe_rmse_m_s"] == errors[1]
    assert found["edvo-paper"]["worst_rpe_rmse_m_s"] == errors[2]
    assert "worst" in outcome.out


def test_memory(edvo: Command, whole_sequence: Path, tmp_path: Path) -> None:
    outcome = edvo(
        *("compare", whole_sequence, "--memory", "--max-frames", 4, "-o", tmp_path),
        *("--with", "zero-motion"),
    )
    assert outcome.status == 0, outcome.err
    found = rows(tmp_path)
    assert found["edvo-paper"]["memory_mb"] > 0
    assert found["zero-motion"]["memory_mb"] is None
    assert " MB" in outcome.out


def test_a_recording_without_truth(edvo: Command, sequence: Path, tmp_path: Path) -> None:
    (sequence / "groundtruth.txt").unlink()
    outcome = edvo("compare", sequence, "--with", "opencv-rgb", "-o", tmp_path)
    assert outcome.status == 0, outcome.err
    assert "no ground truth" in outcome.out
    assert "no rank" in outcome.out
    assert "opencv-rgb" in outcome.out
    assert not (tmp_path / "wall-errors.png").exists()
    assert (tmp_path / "wall-paths.png").exists()


def test_frames_that_cannot_be_read(edvo: Command, sequence: Path, tmp_path: Path) -> None:
    (sequence / "rgb/5.png").write_bytes(b"no picture")
    outcome = edvo("compare", sequence, "--with", "opencv-rgb", "-o", tmp_path)
    assert outcome.status == 0, outcome.err
    assert "5.png" in outcome.err
    assert rows(tmp_path)["edvo-default"]["coverage"] == pytest.approx(35 / 36)
    for file in (sequence / "rgb").iterdir():
        file.write_bytes(b"no picture")
    outcome = edvo("compare", sequence, "--with", "opencv-rgb")
    assert outcome.status == 1
    assert "no frame could be read" in outcome.err


def absent(camera: object, seed: int) -> None:
    raise MissingExtraError("Open3D is missing; install it with: pip install 'edvo[open3d]'")


def test_what_is_not_installed_is_a_row_of_a_group_and_an_error_by_name(
    edvo: Command, whole_sequence: Path, tmp_path: Path
) -> None:
    baseline = registry.find_baseline("open3d-hybrid")
    without = registry.Baseline("open3d-hybrid", baseline.title, "open3d", "open3d", absent)  # type: ignore[arg-type]
    members = {"open3d": ("open3d-hybrid",)}
    with (
        patch.dict(registry._ALL, {"open3d-hybrid": without}),
        patch.dict(registry._GROUPS, members),
    ):
        outcome = edvo("compare", whole_sequence, "--with", "open3d", "-o", tmp_path)
        assert outcome.status == 0, outcome.err
        row = rows(tmp_path)["open3d-hybrid"]
        assert row["failure"].startswith("not installed: ")
        assert "edvo[open3d]" in outcome.out
        assert " of 2 in RPE" in outcome.out  # it did not take part
        outcome = edvo("compare", whole_sequence, "--with", "open3d-hybrid")
        assert outcome.status == 1
        assert one_line(outcome.err)
        assert "pip install 'edvo[open3d]'" in outcome.err


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--with", "opencv-rbgd"], "no baseline 'opencv-rbgd'; there are edvo-default, "),
        (["--trajectory", "orb"], "--trajectory orb: write NAME=FILE"),
        (["--trajectory", "orb=nowhere.txt"], "cannot read nowhere.txt"),
        (["--trajectory", "opencv-rgb=x.txt"], "choose another name"),
        (["--preset", "paper"], "--variants"),
        (["--variants", "--preset", "best"], "no preset 'best'"),
        (["--severity", "0.5"], "name a model of light"),
        (["--light", "disco"], "disco"),
        (["--start", "99"], "there is no frame 99"),
        (["--camera", "nowhere.yaml"], "nowhere.yaml"),
        (["--format", "bag2"], "unknown format 'bag2'"),
    ],
)
def test_bad_input_is_one_line(
    edvo: Command, whole_sequence: Path, tmp_path: Path, arguments: list[str], said: str
) -> None:
    outcome = edvo("compare", whole_sequence, "-o", tmp_path / "out", *arguments)
    assert outcome.status == 1
    assert one_line(outcome.err), outcome.err
    assert said in outcome.err
    assert not (tmp_path / "out").exists()


def test_a_trajectory_file_that_is_none(
    edvo: Command, whole_sequence: Path, tmp_path: Path
) -> None:
    (tmp_path / "kitti.txt").write_text("1 0 0 0 0 1 0 0 0 0 1 0\n")
    outcome = edvo("compare", whole_sequence, "--trajectory", f"orb={tmp_path}/kitti.txt")
    assert outcome.status == 1
    assert one_line(outcome.err)
    assert "12 values instead of 8" in outcome.err


def test_no_source(edvo: Command, tmp_path: Path) -> None:
    assert edvo("compare").status == 2
    outcome = edvo("compare", tmp_path / "nowhere")
    assert (outcome.status, one_line(outcome.err)) == (1, True)


def test_a_full_disk_leaves_nothing_half(
    edvo: Command, whole_sequence: Path, tmp_path: Path
) -> None:
    with full_disk(files=3):
        outcome = edvo(
            "compare", whole_sequence, "--with", "zero-motion", "--max-frames", 5, "-o", tmp_path
        )
    assert outcome.status == 1
    assert "No space left" in outcome.err
    assert not list(tmp_path.rglob(".*"))


@pytest.mark.parametrize(("how", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_interrupted(
    whole_sequence: Path, tmp_path: Path, how: signal.Signals, status: int
) -> None:
    both = (whole_sequence, "synth:texture_far")  # the other one is not reached
    done = interrupted(
        "compare.progress = progress",
        *("compare", *both, "--with", "opencv-rgb", "-o", tmp_path),
        steps=25,
        how=how,
    )
    assert done.status == status, done.err
    assert "interrupted after 0 of 2 sequences" in done.err
    (sequence,) = read(tmp_path)["sequences"]
    assert sequence["interrupted"] is True
    assert sequence["frames"] == 25
    assert {row["frames"] for row in sequence["rows"]} == {sequence["frames"]}
    assert "then interrupted" in (tmp_path / "compare.md").read_text()
    assert "edvo-default" in done.out
    assert not list(tmp_path.rglob(".*"))


def test_help_names_the_groups(edvo: Command) -> None:
    outcome = edvo("compare", "--help")
    assert outcome.status == 0
    assert "opencv" in outcome.out
    assert importlib.util.find_spec("edvo.cli.compare") is not None


def test_a_folder_used_again_holds_one_comparison(
    edvo: Command, whole_sequence: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    few = ("--max-frames", "5", "-o", out)
    assert edvo("compare", "synth:cabinet", whole_sequence, "--with", "orb-pnp", *few).status == 0
    first = read(out)["files"]
    assert all((out / name).is_file() for name in first)
    (out / "mine.png").write_text("not of edvo")
    (out / "trajectories" / "mine.txt").write_text("not of edvo")
    assert edvo("compare", whole_sequence, "--with", "zero-motion,opencv-rgb", *few).status == 0
    second = set(read(out)["files"])
    there = {
        file.relative_to(out).as_posix()
        for file in out.rglob("*")
        if file.suffix in (".png", ".txt")
    }
    assert there == second | {"mine.png", "trajectories/mine.txt"}
    assert not second.issuperset(first)


@pytest.mark.parametrize(
    "text", ["", "[]", '{"files": 3}', '{"files": [3]}', '{"files": ["../beside.txt", "a.md"]}']
)
def test_only_what_a_comparison_wrote_is_removed(tmp_path: Path, text: str) -> None:
    out = tmp_path / "out"
    out.mkdir()
    others = (tmp_path / "beside.txt", out / "a.md")
    for file in others:
        file.write_text("not of edvo")
    (out / "compare.json").write_text(text)
    compare_module.remove_earlier(out)
    assert all(file.exists() for file in others)


def test_a_single_frame_is_no_measure_of_time(edvo: Command, whole_sequence: Path) -> None:
    done = edvo("compare", whole_sequence, "--with", "opencv-rgb", "--max-frames", "1")
    assert done.status == 0
    assert ": 1 frame\n" in done.out
    assert "faster" not in done.out
    assert "slower" not in done.out
