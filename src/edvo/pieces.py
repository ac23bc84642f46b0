"""The pieces of a path: one from the first frame on, and one for each time it begins anew.

Not in the paper. Where pieces are to one another is not known until the camera sees what it saw
before.
"""

import math

# What was seen before is looked for no more often than that, half as often after so long, and so
# seldom in the end.
PERIOD_S, SLOWER_S, LONGEST_S = 0.5, 10.0, 2.0


class Pieces:
    """Knows in which piece a camera is, and for how long it has been apart from the first.

    Attributes
    ----------
    here : int
        The piece; 0 is that of the first frame.
    since : float
        When it was last known where it is to the first piece, seconds.
    """

    def __init__(self) -> None:
        self.here, self.since = 0, -math.inf
        self._count = 0
        self._asked = -math.inf

    @property
    def following(self) -> int:
        """The piece that would begin next."""
        return self._count + 1

    def begin(self, timestamp: float, known_s: float) -> None:
        """Begin a piece.

        Parameters
        ----------
        timestamp : float
            Seconds.
        known_s : float
            When it was last known where the camera is, seconds.
        """
        self.enter(self.following, known_s)
        self._count, self._asked = self.here, timestamp

    def enter(self, piece: int, known_s: float) -> None:
        """Be found in a piece, perhaps one that was left before.

        Parameters
        ----------
        piece : int
        known_s : float
            When it was last known where the camera is, seconds.
        """
        if not self.here:
            self.since = known_s
        self.here = piece

    def gap(self, timestamp: float) -> float:
        """Say for how long it has been apart from the first piece.

        Parameters
        ----------
        timestamp : float
            Seconds.

        Returns
        -------
        float
            Seconds.
        """
        return max(timestamp - self.since, 0.0)

    def may_ask(self, timestamp: float) -> bool:
        """Say whether it is time to look for what was seen before; if so, that counts as looked.

        Parameters
        ----------
        timestamp : float
            Seconds.

        Returns
        -------
        bool
        """
        wait = min(PERIOD_S * (1 + self.gap(timestamp) / SLOWER_S), LONGEST_S)
        if abs(timestamp - self._asked) < wait:
            return False
        self._asked = timestamp
        return True

    def rewind(self, timestamp: float) -> None:
        """Take note of a clock that has jumped back.

        Parameters
        ----------
        timestamp : float
            To there, seconds.
        """
        self.since, self._asked = timestamp, -math.inf
