"""Poses as the ground truth of the EuRoC MAV data sets is written."""

from decimal import Decimal

from edvo import se3
from edvo.trajectory import Trajectory

HEADER = (
    "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m],q_RS_w [],q_RS_x [],q_RS_y [],q_RS_z []"
)


def to_euroc(trajectory: Trajectory) -> str:
    """Format poses as CSV.

    Parameters
    ----------
    trajectory : Trajectory
        ``T_world_cam``. The "sensor" S of the columns' names is the camera, and R the world.

    Returns
    -------
    str
        Whole nanoseconds, position, quaternion with w first.
    """
    lines = [HEADER]
    rows = zip(trajectory.stamps, trajectory.timestamps.tolist(), trajectory.poses, strict=True)
    for stamp, time, pose in rows:
        translation, quaternion = se3.to_quaternion(pose)
        x, y, z, w = quaternion.tolist()
        values = (*translation.tolist(), w, x, y, z)
        lines.append(
            ",".join([str(_nanoseconds(stamp, time)), *(f"{value + 0.0:.12g}" for value in values)])
        )
    return "\n".join(lines) + "\n"


def _nanoseconds(stamp: str, time: float) -> int:
    """Take the stamp's own digits: a float of seconds since 1970 errs by 100 ns.

    Stamps that are frame numbers stand for other times, and those count.
    """
    try:
        exact = Decimal(stamp)
        digits = exact if float(exact) == time else Decimal(time)
    except ArithmeticError:
        digits = Decimal(time)
    return int((digits * 10**9).to_integral_value())
