"""What is to be compared has to be trajectories, and what is asked for numbers."""

from numbers import Real

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


def check_number(name: str, value: object, wanted: str) -> None:
    """See that an option is a real number, which a truth value or a text is not.

    Parameters
    ----------
    name : str
        Of the option.
    value : object
        What was given for it.
    wanted : str
        What to give.

    Raises
    ------
    EvaluationError
        If it is none.
    """
    if not isinstance(value, Real) or isinstance(value, bool):
        raise EvaluationError(f"{name} is {value!r:.40}; give {wanted}")
