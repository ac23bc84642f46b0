"""Stretches of rooms drawn at random, and what the tracker makes of them."""

from benchmarks.room_drawing import draw

from edvo import se3
from edvo.config import Config
from edvo.datasets import read_ahead
from edvo.odometry import Odometry
from edvo.synthesis.sequence import SyntheticSource


def stretch(seed, last, first=0):
    """Camera, frames from ``first`` to before ``last``, and their poses in the first's camera."""
    source = SyntheticSource(draw(seed).recipe(last))
    frames = [reading.frame for reading in read_ahead(source, range(first, last))]
    truth = [source.recipe.motion.at(frame.timestamp) for frame in frames]
    return source.camera, frames, [se3.inverse(truth[0]) @ T for T in truth]


def tracked(stretch, *overrides, count=None):
    """A tracker of a stretch, or of its first frames, and its results."""
    camera, frames, _ = stretch
    odometry = Odometry(camera, Config().with_overrides(overrides))
    return odometry, [odometry.track(frame) for frame in frames[:count]]
