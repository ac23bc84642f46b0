"""Looking at some frames for what commonly is wrong with recordings.

Each check is a file of its own, says what looks wrong in a line, and says so where it cannot tell.
"""

from collections.abc import Iterator

from edvo.datasets.inspection.blur import check_blur
from edvo.datasets.inspection.delay import check_delay
from edvo.datasets.inspection.depth_range import check_depth_range
from edvo.datasets.inspection.depth_steps import check_depth_steps
from edvo.datasets.inspection.finding import Finding
from edvo.datasets.inspection.focal import check_focal
from edvo.datasets.inspection.light import check_darkness, check_exposure
from edvo.datasets.inspection.looks import Looks, look_at
from edvo.datasets.inspection.order import check_order, check_stamps
from edvo.datasets.inspection.readable import check_readable
from edvo.datasets.inspection.registration import check_registration
from edvo.datasets.inspection.repeats import check_repeats
from edvo.datasets.inspection.size import wrong_size
from edvo.datasets.inspection.step import check_step
from edvo.datasets.inspection.truth import check_truth
from edvo.datasets.inspection.unit import check_unit
from edvo.datasets.inspection.walk import walk_all
from edvo.datasets.source import Source

__all__ = ["Finding", "examine", "inspect"]


def inspect(source: Source) -> list[str]:
    """Say what looks wrong with a recording.

    Parameters
    ----------
    source : Source
        Whose frames; about a hundred are looked at.

    Returns
    -------
    list of str
        The warnings of `examine`, a line each.
    """
    return [warning for finding in examine(source) for warning in finding.warnings]


def examine(source: Source) -> list[Finding]:
    """Check a recording for what commonly is wrong.

    Parameters
    ----------
    source : Source
        Whose frames; about a hundred are looked at.

    Returns
    -------
    list of Finding
        One for each check that could be begun.
    """
    looks = look_at(source)
    return [
        check_readable(looks.problems, looks.looked_at),
        *([wrong_size(looks.other_size, looks.camera)] if looks.other_size else ()),
        check_stamps(looks.timestamps),
        check_unit(looks.timestamps),
        *(_look(looks) if looks.frames else ()),
    ]


def _look(looks: Looks) -> Iterator[Finding]:
    camera, frames = looks.camera, looks.frames
    yield check_depth_range(frames, camera.depth_scale)
    yield check_depth_steps(frames, camera.depth_scale)
    yield check_delay(frames)
    yield check_repeats(looks.spans)
    yield check_registration(frames)
    yield check_order(looks.spans)
    yield check_step(looks.spans, looks.interval)
    yield check_darkness(frames)
    yield check_exposure(looks.spans, looks.interval)
    yield check_blur(frames)
    height, width = frames[0].grey.shape
    if (width, height) != (camera.width, camera.height):
        yield wrong_size((width, height), camera)
        return
    steps = walk_all(looks.walks, camera)
    yield check_truth(steps, looks.truth, camera.depth_scale)
    yield check_focal(steps, camera)
