"""Rolling shutters: the rows of an image are not taken at once, and how to make up for it.

Not in the paper. While the camera moves, an image is sheared and stretched, by some pixels from its
first row to its last: edges then say that the camera has turned, or come nearer. How long the
readout takes shows in how the misfit of edges, times their row, changes with the camera's velocity.
"""

import numpy as np
from numpy.typing import NDArray

from edvo import kernels, se3
from edvo.camera import Camera
from edvo.edges import EdgePixels
from edvo.measuring import Changes, Equations, Estimate, Moment
from edvo.planes import camera_of
from edvo.slack import bend_of

EXPECTED_S = 0.02  # how long a readout takes, before anything is known (one sigma)
LARGEST_S = 0.033  # that is believed: a frame of 30 a second
LEAST_S = 1e-3  # that matters
SHARP_PX = 0.1  # below it residuals are what the equations leave out, and tell no more
TYPICAL_EDGES = 2000  # so many, or more, are asked for the depth that stands in where there is none
NO_ROWS = np.empty(0)


class RollingShutter:
    """Measures how long the readout of an image takes, frame after frame.

    Parameters
    ----------
    camera : Camera
        Of the images.
    solver : kernels.Solver
        Of the registration that the alignments come from.
    rule : str
        See ``MotionConfig.readout``.
    known : float, optional
        The readout, seconds, where by the rule it is known.
    slack : str, optional
        See ``MotionConfig.row_slack``.

    Attributes
    ----------
    estimate : Estimate
        Of the readout, seconds, where it is measured.
    """

    def __init__(
        self,
        camera: Camera,
        solver: kernels.Solver,
        rule: str,
        known: float = 0.0,
        slack: str = "none",
    ) -> None:
        self._gives = slack != "none"
        self._known = known if rule == "known" else None
        self._pinhole, self._solver = camera_of(camera), solver
        # distances have no sign that a velocity could change
        wanted = rule == "measured" and solver.residual == kernels.SIGNED
        self.estimate = Estimate(EXPECTED_S, wanted=wanted)
        self.forget()

    def forget(self) -> None:
        """Take all rows as simultaneous, until there is evidence to the contrary."""
        self.estimate.forget()
        self._changes = Changes()

    @property
    def seconds(self) -> float:
        """From the first row to the last; negative where they are read from below."""
        seconds = self.estimate.value if self._known is None else self._known
        seconds = min(max(seconds, -LARGEST_S), LARGEST_S)
        return seconds if abs(seconds) > LEAST_S else 0.0

    def bends(self, lag: kernels.Lag) -> NDArray[np.float64]:
        """Say what rows are off by, of how an acceleration moves the camera in a period.

        Parameters
        ----------
        lag : Lag
            With its rows.

        Returns
        -------
        ndarray of float64, shape (N,)
            See `edvo.slack.bend_of`; empty where they are to lie where the velocity puts them.
        """
        return bend_of(lag.rows) if self._gives else NO_ROWS

    def rows(self, pixels: NDArray[np.float32]) -> NDArray[np.float64]:
        """Say when edges were seen, as against the middle of the image.

        Parameters
        ----------
        pixels : ndarray of float32, shape (N, 2)

        Returns
        -------
        ndarray of float64, shape (N,)
            Seconds; empty where all are simultaneous.
        """
        seconds = self.seconds
        if not seconds:
            return NO_ROWS
        return (pixels[:, 1].astype(np.float64) / self._pinhole.height - 0.5) * seconds

    def unrolled(
        self,
        edges: EdgePixels,
        velocity: NDArray[np.float64],
        depths: NDArray[np.float32] | None = None,
    ) -> EdgePixels:
        """Put edges where they would be, had the whole image been taken at once.

        Parameters
        ----------
        edges : EdgePixels
        velocity : ndarray of float64, shape (6,)
            Of the camera, [v, w] in its own frame, 1/s.
        depths : ndarray of float32, shape (N,), optional
            Of the edges, metres, where they do not have their own; where there is none (0), the
            middle one of all has to do.

        Returns
        -------
        EdgePixels
            With the gradients and the profiles that they had.
        """
        seconds = self.seconds
        return unroll(edges, seconds, velocity, self._pinhole, depths) if seconds else edges

    def learn(self, moment: Moment, key_velocity: NDArray[np.float64] | None = None) -> float:
        """Compare how the misfit of edges by rows changes with how the velocity does.

        Parameters
        ----------
        moment : Moment
            A frame that is to be trusted.
        key_velocity : ndarray of float64, shape (6,), optional
            Of the camera at its keyframe, 1/s.

        Returns
        -------
        float
            How surely the frame tells, one over the variance in 1/s^2, as far as it moves otherwise
            than its keyframe did; 0 where that is not asked for, or nothing to try readouts on.
        """
        if not self.estimate.wanted:
            return 0.0
        alignment, samples = moment.alignment, moment.seen.samples
        T, sigma = alignment.T_ref_cur, alignment.sigma_px
        H_row, H_rows, b_row = np.zeros((6, 6)), np.zeros((6, 6)), np.zeros(6)
        kernels.row_equations(
            samples.pixels,
            samples.depths,
            moment.keyframe.edges.edges.gradients,
            alignment.matches,
            alignment.residuals,
            alignment.trust,
            self._pinhole,
            T,
            self._solver.weight,
            self._solver.tuning,
            sigma,
            1,
            H_row,
            H_rows,
            b_row,
        )
        to_reference = se3.adjoint(T)
        velocity = to_reference @ moment.velocity
        certainty = 0.0
        if key_velocity is not None:
            apart = velocity - key_velocity
            shown = Equations(float(apart @ H_rows @ apart), 0.0, H_row @ apart, np.zeros(6))
            certainty = shown.certainty(alignment, SHARP_PX)
        # at the velocity of both steps, and as if nothing had been made up for
        faster = moment.expected + alignment.faster / moment.period
        unmade = -self._made_up(moment) * (to_reference @ faster)
        change = self._changes.of(
            H_rows,
            np.array([velocity, unmade]),
            b_row + H_rows @ unmade,
            moment.keyframe,
            moment.period,
        )
        if change is None:
            return certainty
        told = Equations(
            float(change.whole @ H_rows @ change.twists[0]),
            float(change.whole @ change.gradient),
            *(change.twists @ H_row),
        )
        self.estimate.learn(told, alignment, moment.period, SHARP_PX)
        return certainty

    def _made_up(self, moment: Moment) -> float:
        """The readout that a registration has made up for; another may be believed by now."""
        rows = moment.alignment.lag.rows
        if not len(rows):
            return 0.0
        k = int(np.argmax(np.abs(rows)))
        place = float(moment.alignment.pixels[k, 1]) / self._pinhole.height - 0.5
        return float(rows[k]) * moment.period / place if place else 0.0


def unroll(
    edges: EdgePixels,
    seconds: float,
    velocity: NDArray[np.float64],
    camera: kernels.Pinhole,
    depths: NDArray[np.float32] | None = None,
) -> EdgePixels:
    """Put edges where they would be, had all rows been taken at once.

    Parameters
    ----------
    edges : EdgePixels
    seconds : float
        From the first row of the image to the last.
    velocity, depths
        See ``RollingShutter.unrolled``.
    camera : kernels.Pinhole

    Returns
    -------
    EdgePixels
        With the gradients that they had.
    """
    depths = edges.depths if depths is None else depths
    typical = np.float32(np.inf)
    if np.count_nonzero(depths) < len(depths):
        known = depths[:: max(len(depths) // TYPICAL_EDGES, 1)]
        known = known[known > 0] if known.any() else depths[depths > 0]
        middle = len(known) // 2
        typical = np.partition(known, middle)[middle] if len(known) else typical
    pixels, moved = np.empty(edges.pixels.shape, np.float32), np.empty_like(depths)
    kernels.unroll_pixels(
        edges.pixels.ravel(), depths, typical, seconds, velocity, camera, pixels.reshape(-1), moved
    )
    return EdgePixels(pixels, edges.gradients, moved, edges.profiles)
