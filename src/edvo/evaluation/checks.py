"""What is to be compared has to be trajectories."""

from edvo.errors import EvaluationError
from edvo.trajectory import Trajectory


def check_trajectories(reference: Trajectory, estimate: Trajectory) -> None:
    """See that both are trajectories.

    Parameters
    ----------
    reference, estimate : Trajectory
        True and estimated poses.

    Raises
    ------
    EvaluationError
        If one is something else, such as an array of poses, which has no times.
    """
    for name, given in (("reference", reference), ("estimate", estimate)):
        if not isinstance(given, Trajectory):
            raise EvaluationError(
                f"{name} is {type(given).__name__}; give a Trajectory, as Trajectory.read or "
                "Trajectory.from_poses makes it"
            )
