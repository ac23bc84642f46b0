"""What is said about a set of errors."""

from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Statistics:
    """Root mean square, mean, median, standard deviation, least and largest of some errors.

    Parameters
    ----------
    rmse, mean, median, std, min, max : float
        In the unit of the errors.
    """

    rmse: float
    mean: float
    median: float
    std: float
    min: float
    max: float

    @classmethod
    def of(cls, errors: NDArray[np.float64]) -> "Statistics":
        """Summarise errors.

        Parameters
        ----------
        errors : ndarray, shape (M,), float64
            At least one, not negative.

        Returns
        -------
        Statistics
            In the unit of the errors.
        """
        return cls(
            rmse=float(np.sqrt(np.mean(errors**2))),
            mean=float(np.mean(errors)),
            median=float(np.median(errors)),
            std=float(np.std(errors)),
            min=float(np.min(errors)),
            max=float(np.max(errors)),
        )

    def to_dict(self) -> dict[str, float]:
        """Give the numbers by name."""
        return asdict(self)
