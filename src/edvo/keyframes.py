"""Keyframes: the references that frames are registered with, and when to take a new one (§V-C)."""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from edvo import se3
from edvo.camera import Camera
from edvo.chamfer import ChamferMap
from edvo.config import KeyframesConfig
from edvo.edges import EdgePixels
from edvo.look import Look
from edvo.matching import EdgeIndex
from edvo.planes import PlaneMap, PlanePoints

UNKNOWN = 1e6  # m; how far apart keyframes of different pieces are


@dataclass(frozen=True, slots=True)
class Keyframe:
    """A frame that others are registered with.

    Attributes
    ----------
    index : int
        Of the frame in the sequence.
    T_world_key : ndarray of float64, shape (4, 4)
    edges : EdgeIndex
        All its edges, faint ones, too; those without depth serve as well.
    telling : EdgeIndex
        The first of these, which are not faint: to tell places by.
    planes : PlaneMap
        The planes that its depth image shows; none where the term is left out.
    samples : EdgePixels
        Some of those that tell places, with depth, and
    points : PlanePoints
        points on its planes, to register it with a frame the other way round.
    look : Look
        To know its place again by.
    chamfer : ChamferMap
        To tell at a glance where another frame may have been taken.
    timestamp : float
        Seconds.
    piece : int
        Of the path that it belongs to: 0 is that of the first frame; where others are to that is
        not known.
    gathered : int
        How many of its edges, the last ones, later frames have shown; see `edvo.gathering`.
    gathered_at : float
        When the last of these was taken, seconds; minus infinity where there is none.
    is_faint : bool
        Whether it was made with faint edges; what it gathers are others.
    """

    index: int
    T_world_key: NDArray[np.float64]
    edges: EdgeIndex
    telling: EdgeIndex
    planes: PlaneMap
    samples: EdgePixels
    points: PlanePoints
    look: Look
    chamfer: ChamferMap
    timestamp: float
    piece: int = 0
    gathered: int = 0
    gathered_at: float = -math.inf
    is_faint: bool = False

    def edges_for(self, *, near: bool) -> EdgeIndex:
        """Give the edges that a frame is registered with.

        Parameters
        ----------
        near : bool
            Whether the frame follows the last one closely, and is not to tell places.

        Returns
        -------
        EdgeIndex
        """
        return self.edges if near else self.telling

    def moved(self, edges: EdgeIndex, telling: EdgeIndex, camera: Camera) -> "Keyframe":
        """Put its edges elsewhere; what it has gathered is left out.

        Parameters
        ----------
        edges, telling : EdgeIndex
            All of them, and the first ones.
        camera : Camera

        Returns
        -------
        Keyframe
        """
        return replace(
            self,
            edges=edges,
            telling=telling,
            look=Look(telling.edges, camera),
            chamfer=ChamferMap(telling.edges, camera),
            gathered=0,
            gathered_at=-math.inf,
        )


class KeyframeStore:
    """Keyframes to find back to, spread over the places that were seen.

    Parameters
    ----------
    capacity : int
        Once it is exceeded, one of the two of a piece that are nearest to each other goes: the
        older.
    """

    def __init__(self, capacity: int) -> None:
        self._capacity = capacity
        self._keyframes: list[Keyframe] = []

    def __len__(self) -> int:
        return len(self._keyframes)

    def add(self, keyframe: Keyframe) -> None:
        """Keep a keyframe."""
        self._keyframes.append(keyframe)
        if len(self._keyframes) > self._capacity:
            del self._keyframes[self._most_crowded()]

    def replace(self, keyframe: Keyframe, by: Keyframe) -> None:
        """Put another in the place of a keyframe, if that is still there.

        Parameters
        ----------
        keyframe, by : Keyframe
        """
        self._keyframes = [by if each is keyframe else each for each in self._keyframes]

    def drop_since(self, keyframe: Keyframe) -> None:
        """Drop those of its piece that are later than a keyframe: where they are is not known.

        Parameters
        ----------
        keyframe : Keyframe
            Is kept, or kept again.
        """
        self._keyframes = [
            each
            for each in self._keyframes
            if each.piece != keyframe.piece or each.index < keyframe.index
        ]
        self.add(keyframe)

    def places(self, piece: int) -> list[tuple[int, NDArray[np.float64]]]:
        """Give the places of a piece.

        Parameters
        ----------
        piece : int

        Returns
        -------
        list of (int, ndarray of float64, shape (4, 4))
            Index and T_world_key of each keyframe that belongs to it, oldest first.
        """
        return [(key.index, key.T_world_key) for key in self._keyframes if key.piece == piece]

    def likest(self, look: Look, count: int) -> list[Keyframe]:
        """Choose the keyframes that look most like a frame.

        Parameters
        ----------
        look : Look
            Of the frame.
        count : int
            How many.

        Returns
        -------
        list of Keyframe
            The likest first.
        """
        return sorted(self._keyframes, key=lambda keyframe: -look.likeness(keyframe.look))[:count]

    def near(self, T_world_cam: NDArray[np.float64], piece: int, reach: float) -> list[Keyframe]:
        """Choose the keyframes near to a pose.

        Parameters
        ----------
        T_world_cam : ndarray of float64, shape (4, 4)
        piece : int
            That they belong to.
        reach : float
            Metres that they are off at most; a radian counts as a metre.

        Returns
        -------
        list of Keyframe
            The nearest first.
        """
        off = {}
        for i, key in enumerate(self._keyframes):
            if key.piece == piece:
                T = se3.inverse(key.T_world_key) @ T_world_cam
                off[i] = math.hypot(*T[:3, 3].tolist()) + se3.rotation_angle(T)
        return [self._keyframes[i] for i in sorted(off, key=off.__getitem__) if off[i] < reach]

    def before(self, piece: int) -> "KeyframeStore":
        """Choose the keyframes of earlier pieces.

        Parameters
        ----------
        piece : int

        Returns
        -------
        KeyframeStore
        """
        earlier = KeyframeStore(self._capacity)
        earlier._keyframes = [keyframe for keyframe in self._keyframes if keyframe.piece < piece]
        return earlier

    def newest(self) -> Keyframe:
        """Give the keyframe taken last."""
        return self._keyframes[-1]

    def move(self, piece: int, into: int, T: NDArray[np.float64]) -> None:
        """Move a piece to where it belongs.

        Parameters
        ----------
        piece : int
        into : int
            The piece that it then is a part of.
        T : ndarray of float64, shape (4, 4)
            Maps points of the world from where they were to where they belong.
        """
        self._keyframes = [
            replace(key, piece=into, T_world_key=T @ key.T_world_key) if key.piece == piece else key
            for key in self._keyframes
        ]

    def _most_crowded(self) -> int:
        """Position of the older one of the nearest two; a radian counts as a metre."""
        T = np.array([keyframe.T_world_key for keyframe in self._keyframes])
        apart = np.linalg.norm(T[:, None, :3, 3] - T[None, :, :3, 3], axis=2)
        cosine = (np.einsum("aij,bij->ab", T[:, :3, :3], T[:, :3, :3]) - 1) / 2
        apart += np.arccos(np.clip(cosine, -1, 1))
        piece = np.array([keyframe.piece for keyframe in self._keyframes])
        apart[piece[:, None] != piece] += UNKNOWN
        apart[np.tril_indices(len(T))] = np.inf
        return int(np.argmin(apart)) // len(T)


def is_due(
    config: KeyframesConfig,
    T_key_cur: NDArray[np.float64],
    overlap: float,
    age: int,
    *,
    well_placed: bool = False,
    close: bool = True,
) -> bool:
    """Whether the frame just tracked should become the next keyframe.

    Parameters
    ----------
    config : KeyframesConfig
    T_key_cur : ndarray of float64, shape (4, 4)
        Motion since the keyframe.
    overlap : float
        Share of the frame's samples that fit the keyframe.
    age : int
        Frames since the keyframe.
    well_placed : bool
        Whether it is better constrained than the frames of late, which lowers the bounds on
        motion. That on overlap stays: where light changes, it falls without any motion.
    close : bool
        Whether it follows closely on the last one, and all of it was registered: else the wider
        bound on translation counts.

    Returns
    -------
    bool
    """
    if config.rule == "gap":
        return age >= config.gap_frames
    reach = config.early_share if well_placed else 1.0
    return overlap < config.min_overlap or is_beyond(config, T_key_cur, reach, close=close)


def is_beyond(
    config: KeyframesConfig, T_key_cur: NDArray[np.float64], share: float, *, close: bool = True
) -> bool:
    """Whether the camera has left a keyframe by more than a share of the bounds on motion.

    Parameters
    ----------
    config : KeyframesConfig
    T_key_cur : ndarray of float64, shape (4, 4)
        Motion since the keyframe.
    share : float
    close : bool
        Whether ``max_translation_m`` counts, or ``far_translation_m`` where that is more.

    Returns
    -------
    bool
    """
    most = config.max_translation_m
    if not close:
        most = max(most, config.far_translation_m)
    x, y, z = T_key_cur[:3, 3].tolist()
    return math.hypot(x, y, z) > share * most or se3.rotation_angle(
        T_key_cur
    ) > share * math.radians(config.max_rotation_deg)
