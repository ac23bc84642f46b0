import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from edvo import se3
from edvo.errors import OutputError, TrajectoryError
from edvo.trajectory import Trajectory, nearest_indices, stamp_text

finite = st.floats(-500.0, 500.0, allow_nan=False)
angle = st.floats(-2.0, 2.0, allow_nan=False)
twists = st.tuples(finite, finite, finite, angle, angle, angle)


def line(count=5, start=10.0):
    poses = [se3.exp(np.array([0.1 * i, 0, 0, 0, 0.05 * i, 0])) for i in range(count)]
    return Trajectory.from_poses(start + 0.1 * np.arange(count), np.array(poses))


@given(st.lists(twists, min_size=1, max_size=6), st.floats(0.0, 2e9))
@settings(max_examples=60)
def test_a_file_gives_the_same_poses_back(tmp_path_factory, pose_twists, start):
    poses = np.array([se3.exp(np.array(twist)) for twist in pose_twists])
    times = start + 0.033 * np.arange(len(poses))
    path = tmp_path_factory.mktemp("trajectory") / "t.txt"
    written = Trajectory.from_poses(times, poses)
    written.write(path)
    back = Trajectory.read(path)
    assert back.stamps == written.stamps
    np.testing.assert_array_equal(back.timestamps, written.timestamps)
    scale = max(1.0, np.abs(poses[:, :3, 3]).max() / 500.0)
    np.testing.assert_allclose(back.poses, written.poses, atol=1e-9 * scale, rtol=0)


@given(st.floats(0.0, 4e9))
def test_generated_stamps_read_back_and_have_six_decimals(time):
    text = stamp_text(time)
    assert float(text) == time
    assert "e" not in text
    assert len(text.split(".")[1]) >= 6


def test_stamps_stay_as_the_source_writes_them(tmp_path):
    (tmp_path / "a.txt").write_text("1305031102.1700 0 0 0 0 0 0 1\n1305031103 1 2 3 0 0 0 -2\n")
    trajectory = Trajectory.read(tmp_path / "a.txt")
    trajectory.write(tmp_path / "b.txt")
    rows = (tmp_path / "b.txt").read_text().splitlines()[1:]
    assert [row.split()[0] for row in rows] == ["1305031102.1700", "1305031103"]


def test_written_values_have_nine_significant_digits_at_least():
    text = line().to_tum()
    for row in text.splitlines()[1:]:
        for value in row.split()[1:]:
            digits = value.lstrip("-").split("e")[0].replace(".", "")
            assert len(digits.lstrip("0") or digits) >= 9, value
            assert not value.startswith("-0.00000000000")


def test_reading_takes_comments_commas_tabs_blanks_a_bom_and_any_order(tmp_path):
    path = tmp_path / "t.txt"
    path.write_bytes(
        b"\xef\xbb\xbf# timestamp tx ty tz qx qy qz qw\r\n\r\n"
        b"2.0, 1, 2, 3, 0, 0, 0, 1\r\n  # remark\r\n1.0\t4 5 6 0 0 0.7071 0.7071\r\n"
    )
    trajectory = Trajectory.read(path)
    assert trajectory.stamps == ("1.0", "2.0")
    np.testing.assert_allclose(trajectory.poses[0][:3, 3], [4, 5, 6])
    np.testing.assert_allclose(trajectory.poses[0][:2, :2], [[0, -1], [1, 0]], atol=1e-12)


@pytest.mark.parametrize(
    ("row", "words"),
    [
        ("3.0 1 2 3 0 0 0", "7 values instead of 8"),
        ("3.0 1 2 3 0 0 0 1 9", "9 values instead of 8"),
        ("3.0 1 2 x 0 0 0 1", "could not convert"),
        ("3.0 1 2 nan 0 0 0 1", "not finite"),
        ("inf 1 2 3 0 0 0 1", "not finite"),
        ("3.0 1 2 3 0 0 0 0", "quaternion is zero"),
        ("1.00 1 2 3 0 0 0 1", "stands on line 2 too"),
    ],
)
def test_a_bad_row_is_named_by_file_and_line(tmp_path, row, words):
    path = tmp_path / "bad.txt"
    path.write_text(f"# header\n1.0 0 0 0 0 0 0 1\n\n{row}\n")
    with pytest.raises(TrajectoryError, match=words) as caught:
        Trajectory.read(path)
    assert f"{path}:4:" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_missing_empty_and_binary_files_are_refused(tmp_path):
    (tmp_path / "empty.txt").write_text("# nothing\n")
    (tmp_path / "binary.txt").write_bytes(b"\x89PNG\xff\xfe\x00")
    for name, words in [
        ("no.txt", "cannot read"),
        ("empty.txt", "no poses"),
        ("binary.txt", "no text"),
    ]:
        with pytest.raises(TrajectoryError, match=words):
            Trajectory.read(tmp_path / name)


def test_writing_where_it_cannot_be_leaves_nothing(tmp_path):
    with pytest.raises(OutputError):
        line().write(tmp_path / "missing" / "t.txt")
    assert list(tmp_path.iterdir()) == []


def test_poses_are_sorted_copied_and_frozen():
    times = np.array([2.0, 1.0])
    poses = np.array([se3.exp(np.array([2.0, 0, 0, 0, 0, 0])), np.eye(4)])
    trajectory = Trajectory.from_poses(times, poses, ["two", "one"])
    assert trajectory.stamps == ("one", "two")
    poses[:] = 0
    assert trajectory.poses[1, 0, 3] == 2.0
    with pytest.raises(ValueError, match="read-only"):
        trajectory.poses[0, 0, 3] = 1.0


@pytest.mark.parametrize(
    ("times", "poses", "words"),
    [
        ([1.0, 1.0], np.tile(np.eye(4), (2, 1, 1)), "does not follow"),
        ([1.0, np.nan], np.tile(np.eye(4), (2, 1, 1)), "not finite"),
        ([1.0], np.full((1, 4, 4), np.inf), "not finite"),
        ([1.0], 2 * np.eye(4)[None], "no rigid motion"),
        ([1.0], np.diag([1.0, 1.0, -1.0, 1.0])[None], "no rigid motion"),
        ([1.0, 2.0], np.eye(4)[None], "do not go together"),
        ([1.0], np.eye(3)[None], "do not go together"),
        ([1.0], 1.0, "do not go together"),
        (["a"], np.eye(4)[None], "times are no array of numbers"),
        ([1.0, 2.0], ["a", "b"], "poses are no array of numbers"),
        ([1.0, 2.0], [np.eye(4), np.eye(3)], "poses are no array of numbers"),
        ([1.0], None, "do not go together"),
        ([1.0], [object()], "poses are no array of numbers"),
        (np.array(["2020-01-01"], "datetime64[ns]"), np.eye(4)[None], "numbers but of datetime64"),
        (np.array([1], "timedelta64[s]"), np.eye(4)[None], "numbers but of timedelta64"),
        (["1"], np.eye(4)[None], "times are no array of numbers but of str"),
        (np.array(["1"], object), np.eye(4)[None], "times are no array of numbers but of str"),
        ([b"1"], np.eye(4)[None], "times are no array of numbers but of bytes"),
        ([True], np.eye(4)[None], "times are no array of numbers but of bool"),
        ([1.0], np.eye(4)[None] > 0, "poses are no array of numbers but of bool"),
        ([1.0], 1j * np.eye(4)[None], "poses are no array of numbers but of complex"),
    ],
)
def test_what_is_no_trajectory_is_refused(times, poses, words):
    with pytest.raises(TrajectoryError, match=words):
        Trajectory.from_poses(times, poses)


@pytest.mark.parametrize(
    ("times", "poses", "stamps", "words"),
    [
        (1.0, np.eye(4), ("1",), "do not go together"),
        (1.0, np.eye(4)[None], ("1",), "do not go together"),
        ([[1.0]], np.eye(4)[None], ("1",), "do not go together"),
        ([1.0], np.eye(4)[None], 1, "stamps are 1; give a text for each pose"),
        ([1.0], np.eye(4)[None], (1,), "a stamp is no text"),
        ([1.0], np.eye(4)[None], ("1", "2"), "2 stamps for 1 poses"),
        ([1.0], np.eye(4)[None], "1", "stamps are one text, '1'; give a text for each pose"),
    ],
)
def test_what_does_not_go_together_is_refused(times, poses, stamps, words):
    with pytest.raises(TrajectoryError, match=words):
        Trajectory(times, poses, stamps)


def test_an_empty_trajectory_is_one():
    empty = Trajectory.from_poses([], [])
    assert len(empty) == 0
    assert empty.poses.shape == (0, 4, 4)
    assert empty.to_tum().startswith("#")
    with pytest.raises(TrajectoryError):
        empty.nearest(1.0)
    with pytest.raises(TrajectoryError):
        empty.at(1.0)


def test_between_keeps_both_ends():
    trajectory = line()
    cut = trajectory.between(trajectory.timestamps[1], trajectory.timestamps[3])
    assert cut.stamps == trajectory.stamps[1:4]
    assert len(trajectory.between(99.0, 100.0)) == 0
    assert len(trajectory.between(100.0, 0.0)) == 0


def test_at_interpolates_between_and_gives_the_poses_themselves():
    trajectory = line()
    np.testing.assert_array_equal(trajectory.at(trajectory.timestamps[2]), trajectory.poses[2])
    middle = trajectory.at(float(trajectory.timestamps[1:3].mean()))
    expected = se3.interpolate(trajectory.poses[1], trajectory.poses[2], 0.5)
    np.testing.assert_allclose(middle, expected, atol=1e-9)
    with pytest.raises(TrajectoryError, match="outside the trajectory"):
        trajectory.at(9.0)


def test_nearest_on_a_tie_takes_what_bisection_meets_first():
    times = np.arange(8.0)
    # Bisection of eight meets 4, then 2, 6, then 1, 3, 5, 7, then 0; and it starts with 0 in hand.
    ties = np.array([0.5, 1.5, 2.5, 3.5, 4.5, 5.5, 6.5])
    assert nearest_indices(times, ties).tolist() == [0, 2, 2, 4, 4, 6, 6]


@given(
    st.lists(st.integers(0, 300), min_size=1, max_size=40, unique=True),
    st.lists(st.integers(-20, 620), min_size=1, max_size=20),
)
def test_nearest_is_nearest(times, queries):
    axis = np.sort(np.array(times, dtype=float))
    wanted = np.array(queries) / 2.0
    found = nearest_indices(axis, wanted)
    best = np.abs(axis[None] - wanted[:, None]).min(axis=1)
    np.testing.assert_array_equal(np.abs(axis[found] - wanted), best)


def test_of_equal_stamps_of_a_tracker_the_first_is_kept():
    poses = [se3.exp(np.array([float(i), 0, 0, 0, 0, 0])) for i in range(4)]
    found = Trajectory.from_frames([0.2, 0.1, 0.2, 0.1], poses, ["b", "a", "b again", "a again"])
    assert found.stamps == ("a", "b")
    assert found.poses[:, 0, 3].tolist() == [1.0, 0.0]
    assert len(Trajectory.from_frames([], [])) == 0
    with pytest.raises(TrajectoryError, match="3 timestamps, 4 poses; give one of each a frame"):
        Trajectory.from_frames([0.1, 0.2, 0.3], poses)
    with pytest.raises(TrajectoryError, match="4 timestamps, 4 poses, 1 stamps; give one of each"):
        Trajectory.from_frames([0.1, 0.2, 0.3, 0.4], poses, ["a"])


@pytest.mark.parametrize(
    ("poses", "stamps", "words"),
    [
        (None, None, r"poses are None; give a \(4, 4\) pose for each frame"),
        (1.0, None, r"poses are 1.0; give a \(4, 4\) pose for each frame"),
        ([np.eye(4)] * 2, 1, "stamps are 1; give a text for each pose"),
        ([np.eye(4)] * 2, "12", "stamps are one text, '12'; give a text for each pose"),
        ([np.eye(4)] * 2, [1, 2], "a stamp is no text"),
        ("ab", None, "poses are no array of numbers"),
    ],
)
def test_what_a_tracker_cannot_have_given_is_refused(poses, stamps, words):
    with pytest.raises(TrajectoryError, match=words) as told:
        Trajectory.from_frames([0.0, 1.0], poses, stamps)
    assert "\n" not in str(told.value)
