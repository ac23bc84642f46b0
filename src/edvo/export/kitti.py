"""Poses as the KITTI odometry benchmark writes them."""

from edvo.trajectory import Trajectory


def to_kitti(trajectory: Trajectory) -> tuple[str, str]:
    """Format poses and times.

    Parameters
    ----------
    trajectory : Trajectory
        ``T_world_cam``; KITTI's camera has the same axes: x right, y down, z forward.

    Returns
    -------
    (str, str)
        Poses, a row of the upper three rows of each matrix; and times, as KITTI's ``times.txt``:
        seconds since the first pose, a row each. A pose file has no times of its own.
    """
    poses = trajectory.poses[:, :3].reshape(-1, 12) + 0.0
    rows = [" ".join(f"{value:.12g}" for value in row) for row in poses.tolist()]
    times = (trajectory.timestamps - trajectory.timestamps[:1]).tolist()
    return (
        "".join(f"{row}\n" for row in rows),
        "".join(f"{time:.9f}\n" for time in times),
    )
