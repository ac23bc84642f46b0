"""Numbers and words in the viewer: errors, residuals, iterations, times, status."""

import math

import numpy as np

from edvo.odometry import Status
from edvo.report.viewer_library import load_rerun
from edvo.report.viewer_names import ERROR, FIT, ITERATIONS, LOG, STATE, TIMES
from edvo.report.viewer_recorder import Recorder
from edvo.report.viewer_shot import Shot
from edvo.report.viewer_world import COLOURS

CURVES = (
    (f"{ERROR}/translation_mm", "translation, mm", 0x8ECAE6FF),
    (f"{ERROR}/rotation_deg", "rotation, deg", 0xF4A261FF),
    (f"{FIT}/sigma_px", "sigma, px", 0xF4A261FF),
    (f"{FIT}/inliers", "inliers, share", 0x3DDC97FF),
    (ITERATIONS, "iterations", 0xBDB2FFFF),
    (f"{TIMES}/track", "track, in all", 0xFFFFFFFF),
)
STAGE_COLOURS = (0x8ECAE6FF, 0xF9C74FFF, 0xF4A261FF, 0x3DDC97FF, 0xBDB2FFFF, 0xF94144FF)
_LEVELS = {Status.TRACKED: "INFO", Status.DEGRADED: "WARN", Status.LOST: "ERROR"}


class Plots:
    """Draws how the tracker fares.

    Parameters
    ----------
    recorder : Recorder
        Where to.
    title : str
        First line of the log.
    """

    def __init__(self, recorder: Recorder, title: str) -> None:
        self._recorder = recorder
        self._rerun = load_rerun()
        self._said: tuple[Status | None, str] = (None, "")
        self._title = title
        self._stages: set[str] = set()
        states = [status.value for status in Status]
        colours = np.array([COLOURS[status] for status in Status], np.uint32)
        configuration = self._rerun.StateConfiguration(values=states, colors=colours)
        recorder.log(STATE, configuration, static=True)
        for path, name, colour in CURVES:
            self._look(path, name, colour)

    def draw(self, shot: Shot, error: tuple[float, float] | None) -> None:
        """Draw the numbers of a frame.

        Parameters
        ----------
        shot : Shot
        error : (float, float) or None
            Relative pose error, metres and radians, where the truth is known.
        """
        found, result = shot.registration, shot.result
        if error is not None:
            self._plot(f"{ERROR}/translation_mm", 1e3 * error[0])
            self._plot(f"{ERROR}/rotation_deg", math.degrees(error[1]))
        if found is not None:
            if found.matches:  # none where depth was registered alone
                self._plot(f"{FIT}/sigma_px", found.sigma_px)
            self._plot(f"{FIT}/inliers", found.inliers / max(result.samples, 1))
            self._plot(ITERATIONS, found.iterations)
        if shot.track_s is not None:
            self._plot(f"{TIMES}/track", 1e3 * shot.track_s)
        for stage, seconds in shot.stages.items():
            if stage not in self._stages:
                colour = STAGE_COLOURS[len(self._stages) % len(STAGE_COLOURS)]
                self._stages.add(stage)
                self._look(f"{TIMES}/{stage}", stage, colour)
            self._plot(f"{TIMES}/{stage}", 1e3 * seconds)
        self._tell(shot)

    def _look(self, path: str, name: str, colour: int) -> None:
        look = self._rerun.SeriesLines(names=name, colors=np.array([colour], np.uint32))
        self._recorder.log(path, look, static=True)

    def _plot(self, path: str, value: float) -> None:
        self._recorder.log(path, self._rerun.Scalars(float(value)))

    def _tell(self, shot: Shot) -> None:
        """Log what is new: not each frame, but each change of status, and keyframes."""
        result = shot.result
        if self._title:
            self._say(self._title, "INFO")
            self._title = ""
        before, self._said = self._said, (result.status, result.reason)
        if result.status is not before[0]:
            self._recorder.log(STATE, self._rerun.StateChange(state=result.status.value))
        if self._said != before and (result.reason or before[0] is not None):
            words = f"frame {result.index}: {result.status.value}"
            self._say(
                f"{words}: {result.reason}" if result.reason else words, _LEVELS[result.status]
            )
        if result.is_keyframe:
            self._say(f"frame {result.index} is a keyframe", "DEBUG")

    def _say(self, words: str, level: str) -> None:
        self._recorder.log(LOG, self._rerun.TextLog(words, level=level))
