"""Poses over time, and the TUM text files that hold them.

A TUM file has one row a pose, ``timestamp tx ty tz qx qy qz qw``: the camera-to-world motion
``T_world_cam`` as translation in metres and unit quaternion.
"""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from edvo import se3
from edvo.errors import TrajectoryError
from edvo.files import write_atomically
from edvo.numeric import NO_NUMBERS

HEADER = "# timestamp tx ty tz qx qy qz qw"

_ROTATION_TOLERANCE = 1e-6


@dataclass(frozen=True, eq=False)
class Trajectory:
    """The pose of a camera at increasing times.

    Parameters
    ----------
    timestamps : ndarray, shape (N,), float64
        Seconds, strictly increasing.
    poses : ndarray, shape (N, 4, 4), float64
        ``T_world_cam``: rigid motions that map camera points to the world, metres.
    stamps : tuple of str, length N
        The same times as the source writes them; they go to a file unchanged.

    Raises
    ------
    TrajectoryError
        If shapes differ, a value is no number or not finite, times do not increase, or a pose is
        not rigid.

    Notes
    -----
    The arrays are copied and read-only. No poses at all is allowed: an odometry starts so.
    """

    timestamps: NDArray[np.float64]
    poses: NDArray[np.float64]
    stamps: tuple[str, ...]

    def __post_init__(self) -> None:
        timestamps, poses = _numbers("times", self.timestamps), _numbers("poses", self.poses)
        if poses.size == 0:
            poses = poses.reshape(0, 4, 4)
        object.__setattr__(self, "timestamps", timestamps)
        object.__setattr__(self, "poses", poses)
        object.__setattr__(self, "stamps", _texts(self.stamps))
        self._check()
        timestamps.flags.writeable = False
        poses.flags.writeable = False

    def _check(self) -> None:
        count = self.timestamps.size
        if self.timestamps.shape != (count,) or self.poses.shape != (count, 4, 4):
            raise TrajectoryError(
                f"{self.timestamps.shape} times and {self.poses.shape} poses do not go together; "
                "give (N,) times and (N, 4, 4) poses"
            )
        if len(self.stamps) != count:
            raise TrajectoryError(f"{len(self.stamps)} stamps for {count} poses; give one a pose")
        if not (np.isfinite(self.timestamps).all() and np.isfinite(self.poses).all()):
            raise TrajectoryError("a time or a pose is not finite; leave lost frames out")
        late = np.flatnonzero(np.diff(self.timestamps) <= 0)
        if late.size:
            raise TrajectoryError(
                f"time {self.stamps[late[0] + 1]} does not follow {self.stamps[late[0]]}; "
                "sort the poses and give each time once"
            )
        rotations = self.poses[:, :3, :3]
        orthogonal = np.abs(rotations.transpose(0, 2, 1) @ rotations - np.eye(3)) < (
            _ROTATION_TOLERANCE
        )
        rigid = orthogonal.all(axis=(1, 2)) & (np.linalg.det(rotations) > 0)
        rigid &= (self.poses[:, 3] == (0.0, 0.0, 0.0, 1.0)).all(axis=1)
        if not rigid.all():
            stamp = self.stamps[int(np.argmin(rigid))]
            raise TrajectoryError(f"the pose at {stamp} is no rigid motion; orthonormalise it")

    @classmethod
    def from_poses(
        cls,
        timestamps: ArrayLike,
        poses: ArrayLike,
        stamps: Sequence[str] | None = None,
    ) -> "Trajectory":
        """Make a trajectory from poses in any order.

        Parameters
        ----------
        timestamps : array-like, shape (N,)
            Seconds, in any order, each once.
        poses : array-like, shape (N, 4, 4)
            ``T_world_cam``, in the same order.
        stamps : sequence of str, optional
            The times as text; by default written with six decimals or as many more as it takes
            to give the same number again.

        Returns
        -------
        Trajectory
            Sorted by time.

        Raises
        ------
        TrajectoryError
            As the class does.
        """
        times, matrices = _numbers("times", timestamps).reshape(-1), _numbers("poses", poses)
        texts = tuple(map(stamp_text, times.tolist())) if stamps is None else _texts(stamps)
        if matrices.ndim and len(texts) == len(matrices) == len(times):
            order = np.argsort(times, kind="stable")
            times, matrices = times[order], matrices[order]
            texts = tuple(texts[index] for index in order)
        return cls(times, matrices, texts)

    @classmethod
    def from_frames(
        cls,
        timestamps: ArrayLike,
        poses: Sequence[NDArray[np.float64]],
        stamps: Sequence[str] | None = None,
    ) -> "Trajectory":
        """Make a trajectory of what a tracker gave, frame by frame.

        Parameters
        ----------
        timestamps : array-like, shape (N,)
            Seconds; a recording may repeat a stamp or go back.
        poses : sequence of ndarray, N of shape (4, 4)
            ``T_world_cam``, in the same order.
        stamps : sequence of str, optional
            As of `from_poses`.

        Returns
        -------
        Trajectory
            Sorted by time; of frames with the same time it holds the first.

        Raises
        ------
        TrajectoryError
            As the class does.
        """
        times = _numbers("times", timestamps).ravel()
        try:
            poses = tuple(poses)
        except TypeError as error:
            raise TrajectoryError(
                f"poses are {poses!r:.40}; give a (4, 4) pose for each frame"
            ) from error
        counts = {"timestamps": len(times), "poses": len(poses)}
        if stamps is not None:
            stamps = _texts(stamps)
            counts["stamps"] = len(stamps)
        if len(set(counts.values())) > 1:
            told = ", ".join(f"{count} {name}" for name, count in counts.items())
            raise TrajectoryError(f"{told}; give one of each a frame")
        times, first = np.unique(times, return_index=True)
        texts = None if stamps is None else [stamps[i] for i in first]
        return cls.from_poses(times, [poses[i] for i in first], texts)

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> "Trajectory":
        """Read a TUM trajectory file.

        Parameters
        ----------
        path : path-like
            Rows of ``timestamp tx ty tz qx qy qz qw`` in any order, parted by blanks, tabs or
            commas; rows that start with ``#`` and blank ones are passed over.

        Returns
        -------
        Trajectory
            Sorted by time, quaternions normalised, stamps as the file writes them.

        Raises
        ------
        TrajectoryError
            If the file is missing, is no text or holds no pose; or a row is not eight finite
            numbers with a quaternion, or gives a time again. The message names file and line.
        """
        rows: dict[float, tuple[int, str, NDArray[np.float64]]] = {}
        for number, line in enumerate(_text(path).split("\n"), start=1):
            fields = line.replace(",", " ").split()
            if not fields or fields[0].startswith("#"):
                continue
            where = f"{path}:{number}"
            time, pose = _pose_of_row(fields, where)
            if time in rows:
                raise TrajectoryError(
                    f"{where}: time {fields[0]} stands on line {rows[time][0]} too; "
                    "remove one of the rows"
                )
            rows[time] = (number, fields[0], pose)
        if not rows:
            raise TrajectoryError(f"{path}: no poses; rows must be '{HEADER[2:]}'")
        times = sorted(rows)
        return cls(
            np.array(times),
            np.stack([rows[time][2] for time in times]),
            tuple(rows[time][1] for time in times),
        )

    def to_tum(self) -> str:
        """Format as a TUM file.

        Returns
        -------
        str
            A comment row, then a row a pose. Stamps stand as given. Values have twelve
            significant digits always: they come back to 1e-9 m for positions within 1 km, and a
            row still fits a terminal.
        """
        lines = [HEADER]
        for stamp, pose in zip(self.stamps, self.poses, strict=True):
            translation, quaternion = se3.to_quaternion(pose)
            # Adding zero turns -0.0 into 0.0.
            values = (*translation.tolist(), *quaternion.tolist())
            lines.append(" ".join([stamp, *(f"{value + 0.0:#.12g}" for value in values)]))
        return "\n".join(lines) + "\n"

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write a TUM trajectory file, whole or not at all.

        Parameters
        ----------
        path : path-like
            The file; its folder must exist.

        Raises
        ------
        OutputError
            If it cannot be written.
        """
        write_atomically(path, self.to_tum())

    def __len__(self) -> int:
        return len(self.timestamps)

    def between(self, start: float, end: float) -> "Trajectory":
        """Cut out a span of time.

        Parameters
        ----------
        start, end : float
            Seconds; both ends belong to the span.

        Returns
        -------
        Trajectory
            The poses with ``start <= time <= end``, maybe none.
        """
        first = int(np.searchsorted(self.timestamps, start, side="left"))
        last = max(first, int(np.searchsorted(self.timestamps, end, side="right")))
        return Trajectory(
            self.timestamps[first:last], self.poses[first:last], self.stamps[first:last]
        )

    def at(self, time: float) -> NDArray[np.float64]:
        """Interpolate the pose at a time.

        Parameters
        ----------
        time : float
            Seconds, within the trajectory.

        Returns
        -------
        ndarray, shape (4, 4), float64
            ``T_world_cam`` on the motion of constant twist between the two neighbours.

        Raises
        ------
        TrajectoryError
            If the time lies outside the trajectory.
        """
        if not len(self) or not self.timestamps[0] <= time <= self.timestamps[-1]:
            span = f"{self.stamps[0]} to {self.stamps[-1]}" if len(self) else "nothing"
            raise TrajectoryError(
                f"time {stamp_text(time)} is outside the trajectory, which spans {span}; "
                "ask within it"
            )
        after = int(np.searchsorted(self.timestamps, time, side="left"))
        if self.timestamps[after] == time:
            return np.array(self.poses[after])
        before = after - 1
        alpha = (time - self.timestamps[before]) / (
            self.timestamps[after] - self.timestamps[before]
        )
        return se3.interpolate(self.poses[before], self.poses[after], float(alpha))

    def nearest(self, time: float) -> int:
        """Find the pose nearest to a time.

        Parameters
        ----------
        time : float
            Seconds.

        Returns
        -------
        int
            Its index; see `nearest_indices` for ties.

        Raises
        ------
        TrajectoryError
            If there is no pose.
        """
        if not len(self):
            raise TrajectoryError("an empty trajectory has no nearest pose; track a frame first")
        return int(nearest_indices(self.timestamps, np.array([time]))[0])


def nearest_indices(times: NDArray[np.float64], queries: NDArray[np.float64]) -> NDArray[np.intp]:
    """Find the nearest of increasing times for each query.

    Parameters
    ----------
    times : ndarray, shape (N,), float64
        Increasing, at least one.
    queries : ndarray, shape (M,), float64
        In any order.

    Returns
    -------
    ndarray, shape (M,), intp
        Indices into `times`.

    Notes
    -----
    This is the bisection of the TUM evaluation scripts for all queries at once. Stamps have few
    decimals, so that a query does fall half-way between two; then the one wins that bisection
    meets first, and errors agree with published ones only if ties fall the same way.
    """
    start = np.zeros(queries.shape, dtype=np.intp)
    end = np.full(queries.shape, len(times), dtype=np.intp)
    best = np.zeros(queries.shape, dtype=np.intp)
    least = np.abs(times[0] - queries)
    for _ in range(len(times).bit_length()):
        open_ = start < end
        middle = np.where(open_, (start + end) // 2, best)
        distance = np.abs(times[middle] - queries)
        closer = open_ & (distance < least)
        best = np.where(closer, middle, best)
        least = np.where(closer, distance, least)
        above = times[middle] > queries
        end = np.where(open_ & above, middle, end)
        start = np.where(open_ & ~above, middle + 1, start)
    return best


def stamp_text(time: float) -> str:
    """Write a time that no source has written.

    Parameters
    ----------
    time : float
        Seconds.

    Returns
    -------
    str
        Without exponent, at least six decimals, and as many as it takes to read the same number
        back.
    """
    return np.format_float_positional(time, min_digits=6)


def _numbers(name: str, given: ArrayLike) -> NDArray[np.float64]:
    """Copy times or poses as an array, or say that they are none.

    NumPy would take texts, truth values and dates for numbers.
    """
    mend = "give (N,) times and (N, 4, 4) poses"
    try:
        array = np.asarray(given)
        kinds = {type(each) for each in array.flat} if array.dtype == object else {array.dtype.type}
        wrong = [kind.__name__ for kind in kinds if issubclass(kind, NO_NUMBERS)]
        if wrong and array.size:
            raise TrajectoryError(f"{name} are no array of numbers but of {wrong[0]}; {mend}")
        return np.array(array, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise TrajectoryError(f"{name} are no array of numbers; {mend}") from error


def _texts(stamps: Sequence[str]) -> tuple[str, ...]:
    try:
        texts = tuple(stamps)
    except TypeError as error:
        raise TrajectoryError(f"stamps are {stamps!r:.40}; give a text for each pose") from error
    if isinstance(stamps, str):
        raise TrajectoryError(f"stamps are one text, {stamps!r:.40}; give a text for each pose")
    if not all(isinstance(text, str) for text in texts):
        raise TrajectoryError("a stamp is no text; give each as the source writes it")
    return texts


def _text(path: str | os.PathLike[str]) -> str:
    try:
        return Path(path).read_text(encoding="utf-8-sig")
    except OSError as error:
        raise TrajectoryError(
            f"cannot read {path}: {error.strerror or error}; give a TUM trajectory file"
        ) from error
    except UnicodeDecodeError as error:
        raise TrajectoryError(f"{path} is no text file; give a TUM trajectory file") from error


def _pose_of_row(fields: list[str], where: str) -> tuple[float, NDArray[np.float64]]:
    if len(fields) != 8:
        raise TrajectoryError(
            f"{where}: {len(fields)} values instead of 8; write '{HEADER[2:]}' on each row"
        )
    try:
        values = np.array([float(field) for field in fields])
    except ValueError as error:
        raise TrajectoryError(f"{where}: {error}; correct or remove the row") from error
    if not np.isfinite(values).all():
        raise TrajectoryError(f"{where}: a value is not finite; correct or remove the row")
    if np.linalg.norm(values[4:]) < _ROTATION_TOLERANCE:
        raise TrajectoryError(f"{where}: the quaternion is zero; correct or remove the row")
    return float(values[0]), se3.from_quaternion(values[1:4], values[4:])
