"""Knowing again where in space something was seen before."""

from itertools import product

import numpy as np
from numpy.typing import NDArray

_AXIS_BITS = 21  # three axes in one 63-bit key


class Places:
    """Voxels that hold something.

    Parameters
    ----------
    voxel_m : float
        Their width, metres.
    """

    def __init__(self, voxel_m: float) -> None:
        self._voxel_m = voxel_m
        self._keys = np.empty(0, np.int64)  # ascending

    def __len__(self) -> int:
        return len(self._keys)

    def add(self, points: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Add points.

        Parameters
        ----------
        points : ndarray, shape (N, 3)
            Metres.

        Returns
        -------
        ndarray of bool, shape (N,)
            Which of them lie where nothing was before, not within half a voxel either: else what
            lies on a border would be new whenever it trembles.
        """
        scaled = points / self._voxel_m
        known = np.zeros(len(points), bool)
        if len(self._keys):
            for shift in product((-0.5, 0.5), repeat=3):
                keys = _keys(scaled + shift)
                place = np.minimum(np.searchsorted(self._keys, keys), len(self._keys) - 1)
                known |= self._keys[place] == keys
        self._keys = np.union1d(self._keys, _keys(scaled[~known]))
        return ~known


def _keys(scaled: NDArray[np.float64]) -> NDArray[np.int64]:
    half = 1 << (_AXIS_BITS - 1)
    cell = np.clip(np.floor(scaled), -half, half - 1).astype(np.int64) + half
    keys: NDArray[np.int64] = (cell[:, 0] << 2 * _AXIS_BITS) | (cell[:, 1] << _AXIS_BITS)
    return keys | cell[:, 2]
