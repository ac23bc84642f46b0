"""Poses and cameras that are written as matrices of numbers."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from edvo.datasets.listed import Truth
from edvo.datasets.text_files import read_text
from edvo.errors import DatasetError
from edvo.trajectory import Trajectory

# Of R'R - I. Six decimals leave 1e-6, careless files 1e-3; more is no rotation.
_NEARLY_RIGID = 0.02


def read_numbers(file: Path) -> NDArray[np.float64]:
    """Read all numbers of a text file.

    Parameters
    ----------
    file : pathlib.Path
        Numbers parted by blanks, commas or line ends; rows that start with ``#`` are passed over.

    Returns
    -------
    ndarray of float64, shape (N,)
        Infinite and NaN where the file says so.

    Raises
    ------
    DatasetError
        If the file cannot be read or holds something else; the message names it.
    """
    text = read_text(file, "it must hold numbers")
    rows = [row for row in text.splitlines() if not row.lstrip().startswith("#")]
    try:
        return np.array([float(word) for word in " ".join(rows).replace(",", " ").split()])
    except ValueError as error:
        raise DatasetError(f"{file}: {error}; it must hold numbers") from error


def read_matrix(file: Path) -> NDArray[np.float64]:
    """Read a matrix of four rows and four columns.

    Parameters
    ----------
    file : pathlib.Path
        See `read_numbers`; three rows of four, or of three, are filled up.

    Returns
    -------
    ndarray of float64, shape (4, 4)
        The matrix.

    Raises
    ------
    DatasetError
        If it holds another count of numbers.
    """
    numbers = read_numbers(file)
    matrix = np.eye(4)
    if numbers.size == 9:
        matrix[:3, :3] = numbers.reshape(3, 3)
    elif numbers.size in (12, 16):
        matrix[: numbers.size // 4] = numbers.reshape(-1, 4)
    else:
        raise DatasetError(f"{file} holds {numbers.size} numbers; it must be a 4x4 matrix")
    return matrix


def nearest_rotation(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """Find the rotation nearest to a matrix, in the sense of least squares.

    Parameters
    ----------
    matrix : ndarray of float64, shape (3, 3)
        Nearly a rotation.

    Returns
    -------
    ndarray of float64, shape (3, 3)
        U V' of its singular value decomposition, of determinant 1.
    """
    u, _, v = np.linalg.svd(matrix)
    u[:, 2] *= np.sign(np.linalg.det(u @ v))
    return np.asarray(u @ v, np.float64)


def rigid(matrix: NDArray[np.float64]) -> NDArray[np.float64] | None:
    """Take the rounding out of a pose.

    Parameters
    ----------
    matrix : ndarray of float64, shape (4, 4)
        As it was read.

    Returns
    -------
    ndarray of float64, shape (4, 4), or None
        A rigid motion; None where the matrix is not even nearly one, or not finite.
    """
    if not np.isfinite(matrix).all():
        return None
    rotation = matrix[:3, :3]
    off = float(np.abs(rotation.T @ rotation - np.eye(3)).max())
    if off > _NEARLY_RIGID or np.linalg.det(rotation) < 0:
        return None
    T = np.eye(4)
    T[:3, :3] = nearest_rotation(rotation)
    T[:3, 3] = matrix[:3, 3]
    return T


def truth_of(
    frames: Sequence[tuple[str, float]],
    poses: Sequence[NDArray[np.float64]],
    where: Path,
) -> Truth:
    """Make a trajectory of the poses of a recording.

    Parameters
    ----------
    frames : sequence of (str, float)
        Stamp and time of each pose, increasing.
    poses : sequence of ndarray, shape (4, 4)
        ``T_world_cam``, nearly rigid; others are left out, as data sets mark lost frames so.
    where : pathlib.Path
        Where they come from.

    Returns
    -------
    (Trajectory or None, tuple of str)
        The good poses, if any, and a word on those left out.
    """
    kept = [
        (stamp, time, pose)
        for (stamp, time), matrix in zip(frames, poses, strict=True)
        if (pose := rigid(matrix)) is not None
    ]
    warnings: tuple[str, ...] = ()
    if len(kept) < len(poses):
        warnings = (
            f"{where}: {len(poses) - len(kept)} of {len(poses)} poses are no rigid motions: "
            "left out of the ground truth",
        )
    if not kept:
        return None, warnings
    stamps, times, good = zip(*kept, strict=True)
    return Trajectory(np.array(times), np.stack(good), tuple(stamps)), warnings


def truth_of_files(
    frames: Sequence[tuple[str, float]],
    files: Sequence[Path],
    where: Path,
    T_frame_cam: NDArray[np.float64] | None = None,
) -> Truth:
    """Make a trajectory of pose files, one a frame.

    Parameters
    ----------
    frames : sequence of (str, float)
        Stamp and time of each frame, increasing.
    files : sequence of pathlib.Path
        The file of each frame with its 4x4 pose; some may be missing.
    where : pathlib.Path
        Their folder.
    T_frame_cam : ndarray, shape (4, 4), optional
        From the colour camera to the frame that the poses are of, if that is another.

    Returns
    -------
    (Trajectory or None, tuple of str)
        ``T_world_cam``, and what is wrong.
    """
    there = [(frame, file) for frame, file in zip(frames, files, strict=True) if file.is_file()]
    if not there:
        return None, ()
    try:
        poses = [read_matrix(file) for _, file in there]
    except DatasetError as error:
        return None, (f"ground truth not used: {error}",)
    if T_frame_cam is not None:
        with np.errstate(invalid="ignore"):  # lost frames are infinite
            poses = [pose @ T_frame_cam for pose in poses]
    return truth_of([frame for frame, _ in there], poses, where)
