"""Keeping, while a run goes on, what its report and its exports will need: little, however long."""

from collections.abc import Sequence

import numpy as np

from edvo.export.edge_map import EdgeMap
from edvo.frame import Frame
from edvo.odometry import Status, TrackedFrame
from edvo.report.sights import Sight
from edvo.report.tracking import FrameRecord, Tracker

SPANS = 8  # the run is parted into so many, and of each the worst frame and a plain one are kept
WORST_SHOWN = 5
TYPICAL_SHOWN = 3

_RANK = {Status.TRACKED: 0, Status.DEGRADED: 2, Status.LOST: 3}
_STILL_LOST = 1  # what there is to see of a loss is how it began

Doubt = tuple[int, float, float]


class Watch:
    """Hands frames on to a tracker; keeps a few of them, and adds keyframes to a map.

    Parameters
    ----------
    tracker : Tracker
        What tracks.
    frames : int
        How many there will be.
    keep_sights : bool
        Whether frames are kept to be shown.
    edge_map : EdgeMap, optional
        Gets each keyframe.

    Attributes
    ----------
    tracker : Tracker

    Notes
    -----
    At most 16 frames are held at a time.
    """

    def __init__(
        self,
        tracker: Tracker,
        frames: int,
        *,
        keep_sights: bool = True,
        edge_map: EdgeMap | None = None,
    ) -> None:
        self.tracker = tracker
        self._span = max(1, -(-frames // SPANS))
        self._keep_sights = keep_sights
        self._map = edge_map
        self._fresh: Sight | None = None
        self._lost = False
        self._worst: dict[int, tuple[Doubt, Sight]] = {}
        self._plain: dict[int, Sight] = {}

    def track(self, frame: Frame) -> TrackedFrame:
        """Give the pose of a frame; what is kept of it is decided later, outside of its time."""
        result = self.tracker.track(frame)
        self._fresh = Sight(frame, result)
        return result

    def skip(self, timestamp: float, reason: str) -> TrackedFrame:
        """Take note of a frame that could not be read."""
        return self.tracker.skip(timestamp, reason)

    def after(self, record: FrameRecord) -> None:
        """Decide what to keep of the last frame.

        Parameters
        ----------
        record : FrameRecord
            Of that frame, tracked or not.
        """
        sight, self._fresh = self._fresh, None
        still_lost, self._lost = self._lost, record.status is Status.LOST
        if sight is None:
            return
        if self._map is not None and sight.result.is_keyframe:
            self._map.add(sight.frame, sight.result.T_world_cam)
        if self._keep_sights:
            self._choose(sight, doubt(sight.result, still_lost=still_lost))

    def worst(self) -> list[Sight]:
        """Give the frames that were trusted least, from different parts of the run.

        Returns
        -------
        list of Sight
            At most five, by time.
        """
        found = sorted(self._worst.values(), key=lambda pair: pair[0], reverse=True)
        return _by_time([sight for _, sight in found[:WORST_SHOWN]])

    def typical(self, records: Sequence[FrameRecord]) -> list[Sight]:
        """Give frames that went as most did.

        Parameters
        ----------
        records : sequence of FrameRecord
            Of the whole run.

        Returns
        -------
        list of Sight
            At most three, by time; none of `worst`.
        """
        shares = [
            record.registration.inliers / record.samples
            for record in records
            if record.registration is not None and record.samples
        ]
        usual = float(np.median(shares)) if shares else 1.0
        shown = {sight.result.index for sight in self.worst()}
        found = [sight for sight in self._plain.values() if sight.result.index not in shown]
        found.sort(key=lambda sight: abs(1.0 - doubt(sight.result)[1] - usual))
        return _by_time(found[:TYPICAL_SHOWN])

    def _choose(self, sight: Sight, doubted: Doubt) -> None:
        index = sight.result.index
        span = index // self._span
        if span not in self._worst or doubted > self._worst[span][0]:
            self._worst[span] = doubted, sight
        registered = sight.result.alignment is not None
        tracked = sight.result.status is Status.TRACKED
        # From the middle of the span on, since its worst frame is as often its first.
        if registered and tracked and 2 * (index % self._span) >= self._span:
            self._plain.setdefault(span, sight)


def doubt(result: TrackedFrame, *, still_lost: bool = False) -> Doubt:
    """Say how little a frame is to be trusted, to be compared.

    Parameters
    ----------
    result : TrackedFrame
        What was made of it.
    still_lost : bool
        Whether the frame before was lost.

    Returns
    -------
    (int, float, float)
        Its status: tracked, lost as the one before, degraded, lost; the share of the samples
        that do not fit; the scale of their residuals in pixels.
    """
    rank, found = _RANK[result.status], result.alignment
    if still_lost and result.status is Status.LOST:
        rank = _STILL_LOST
    if found is None or not len(found.matches):
        return rank, 0.0 if result.status is Status.TRACKED else 1.0, 0.0
    return rank, 1.0 - found.inliers / len(found.matches), found.sigma_px


def _by_time(sights: list[Sight]) -> list[Sight]:
    return sorted(sights, key=lambda sight: sight.result.index)
