"""Each line of bad input that users meet, through the command itself."""

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from edvo.trajectory import Trajectory

from .conftest import CAMERA, HEIGHT, WIDTH, Command, Outcome, rows, stamp


def statuses(folder: Path) -> dict[str, str]:
    return {row["timestamp"]: row["status"] for row in rows(folder)}


def reasons(folder: Path) -> dict[str, str]:
    return {row["timestamp"]: row["reason"] for row in rows(folder)}


def assert_one_line(done: Outcome, *named: str) -> None:
    assert done.status == 1
    assert done.out == ""
    assert done.err.startswith("edvo: ")
    assert done.err.count("\n") == 1
    for name in named:
        assert name in done.err


def replace_rows(file: Path, change: dict[int, str]) -> None:
    """Rewrite some rows (counted from 0, without the comment)."""
    lines = file.read_text().splitlines()
    for index, line in change.items():
        lines[index + 1] = line
    file.write_text("\n".join(lines) + "\n")


@pytest.mark.parametrize("command", [["run", "-o", "out"], ["info"]])
def test_missing_folder(edvo: Command, tmp_path: Path, command: list[str]) -> None:
    done = edvo(command[0], tmp_path / "nowhere", *command[1:])
    assert_one_line(done, "nowhere")


@pytest.mark.parametrize("name", ["rgb.txt", "depth.txt"])
def test_empty_list(edvo: Command, sequence: Path, tmp_path: Path, name: str) -> None:
    (sequence / name).write_text("# timestamp filename\n")
    assert_one_line(edvo("run", sequence, "-o", tmp_path / "out"), name)


def test_folder_of_no_format(edvo: Command, tmp_path: Path) -> None:
    (tmp_path / "pictures").mkdir()
    assert_one_line(edvo("run", tmp_path / "pictures", "-o", tmp_path / "out"), "pictures", "tum")


@pytest.mark.parametrize("kind", ["rgb", "depth"])
def test_truncated_image_is_skipped(
    edvo: Command, sequence: Path, tmp_path: Path, kind: str
) -> None:
    image = sequence / kind / "12.png"
    image.write_bytes(image.read_bytes()[:-40])
    out = tmp_path / "out"
    done = edvo("run", sequence, "-o", out)
    assert done.status == 0
    assert f"{kind}/12.png" in done.err
    assert "1 unreadable" in done.out
    states = statuses(out)
    assert len(states) == 36
    assert states.pop(stamp(12)) == "lost"
    assert set(states.values()) == {"tracked"}
    assert "12.png" in reasons(out)[stamp(12)]
    assert stamp(12) not in Trajectory.read(out / "trajectory.txt").stamps
    summary = json.loads((out / "summary.json").read_text())
    assert summary["frames"]["unreadable"] == 1
    assert summary["coverage"] == pytest.approx(35 / 36)


def test_missing_image_is_skipped(edvo: Command, sequence: Path, tmp_path: Path) -> None:
    (sequence / "depth/20.png").unlink()
    done = edvo("run", sequence, "-o", tmp_path / "out")
    assert done.status == 0
    assert "depth/20.png" in done.err
    assert statuses(tmp_path / "out")[stamp(20)] == "lost"


@pytest.mark.parametrize("kind", ["rgb", "depth"])
def test_image_of_another_size_is_skipped(
    edvo: Command, sequence: Path, tmp_path: Path, kind: str
) -> None:
    file = str(sequence / kind / "9.png")
    image = cv2.imread(file, cv2.IMREAD_UNCHANGED)
    cv2.imwrite(file, image[: HEIGHT // 2, : WIDTH // 2])
    done = edvo("run", sequence, "-o", tmp_path / "out")
    assert done.status == 0
    assert f"{kind}/9.png" in done.err
    states = statuses(tmp_path / "out")
    assert states.pop(stamp(9)) == "lost"
    assert set(states.values()) == {"tracked"}


def test_all_images_of_another_size(edvo: Command, sequence: Path, tmp_path: Path) -> None:
    (sequence / "camera.yaml").write_text(CAMERA.replace("width: 160", "width: 320"))
    done = edvo("run", sequence, "-o", tmp_path / "out")
    assert done.status == 1
    assert "no frame could be read" in done.err.splitlines()[-1]
    assert set(statuses(tmp_path / "out").values()) == {"lost"}


def test_no_depth_for_a_while(edvo: Command, sequence: Path, tmp_path: Path) -> None:
    for index in range(10, 15):
        cv2.imwrite(str(sequence / f"depth/{index}.png"), np.zeros((HEIGHT, WIDTH), np.uint16))
    out = tmp_path / "out"
    done = edvo("run", sequence, "-o", out)
    assert done.status == 0
    assert "5 unreadable" in done.out
    states = statuses(out)
    assert {s for s, state in states.items() if state == "lost"} == {
        stamp(index) for index in range(10, 15)
    }
    found = Trajectory.read(out / "trajectory.txt")
    truth = Trajectory.read(sequence / "groundtruth.txt")
    assert abs(found.poses[-1, 0, 3] - truth.poses[-1, 0, 3]) < 0.01


def test_stamps_that_repeat_or_go_back(edvo: Command, sequence: Path, tmp_path: Path) -> None:
    again, back = {5: f"{stamp(4)} rgb/5.png"}, {20: 21, 21: 20}
    rows = again | {row: f"{stamp(i)} rgb/{i}.png" for row, i in back.items()}
    replace_rows(sequence / "rgb.txt", rows)
    out = tmp_path / "out"
    done = edvo("run", sequence, "-o", out)
    assert done.status == 0
    assert "rgb.txt" in done.err
    assert "repeat" in done.err
    assert "back" in done.err
    times = Trajectory.read(out / "trajectory.txt").timestamps
    assert len(times) == 35
    assert (np.diff(times) > 0).all()


@pytest.mark.parametrize(
    ("before", "after", "key"),
    [("fx: 150.0\n", "", "fx"), ("cy: 59.5", "cy: middle", "cy"), ("fy: 150.0", "fy: -1", "fy")],
)
def test_bad_camera_file(
    edvo: Command, sequence: Path, tmp_path: Path, before: str, after: str, key: str
) -> None:
    (sequence / "camera.yaml").write_text(CAMERA.replace(before, after))
    assert_one_line(edvo("run", sequence, "-o", tmp_path / "out"), "camera.yaml", key)
    assert not (tmp_path / "out").exists()


def test_no_camera_at_all(edvo: Command, sequence: Path, tmp_path: Path) -> None:
    (sequence / "camera.yaml").unlink()
    assert_one_line(edvo("run", sequence, "-o", tmp_path / "out"), "--camera")
    given = tmp_path / "mine.yaml"
    given.write_text(CAMERA)
    assert edvo("run", sequence, "-o", tmp_path / "out", "--camera", given).status == 0


def test_output_folder_is_a_file(edvo: Command, whole_sequence: Path, tmp_path: Path) -> None:
    (tmp_path / "out").write_text("in the way")
    assert_one_line(edvo("run", whole_sequence, "-o", tmp_path / "out"), "out")
    assert_one_line(edvo("run", whole_sequence, "-o", tmp_path / "out/deeper"), "out")
    assert (tmp_path / "out").read_text() == "in the way"


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="needs a folder nobody can write")
def test_output_folder_takes_no_files(edvo: Command, whole_sequence: Path) -> None:
    assert_one_line(edvo("run", whole_sequence, "-o", "/proc/self"), "/proc/self")


def test_result_that_cannot_be_replaced(
    edvo: Command, whole_sequence: Path, tmp_path: Path
) -> None:
    (tmp_path / "frames.csv").mkdir()
    done = edvo("run", whole_sequence, "-o", tmp_path)
    assert done.status == 1
    assert "frames.csv" in done.err.splitlines()[-1]
    assert not (tmp_path / "summary.json").exists()


def test_unusable_ground_truth_is_a_warning(edvo: Command, sequence: Path, tmp_path: Path) -> None:
    (sequence / "groundtruth.txt").write_text("1 2 three\n")
    done = edvo("run", sequence, "-o", tmp_path / "out")
    assert done.status == 0
    assert "groundtruth.txt" in done.err
    shutil.rmtree(tmp_path / "out")
