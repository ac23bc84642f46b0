"""What cameras have in common that a maker's package drives."""

import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress

from edvo.datasets.devices.waiting import Counter
from edvo.errors import DatasetError


class Driven:
    """A camera that a maker's package drives: how it starts, and how it ends.

    Parameters
    ----------
    fails : type of Exception
        What the package raises.
    """

    ground_truth = None

    def __init__(self, fails: type[Exception]) -> None:
        self._fails = fails
        self._closed = threading.Event()
        self._count = Counter()
        self._stops = ExitStack()  # what has started puts its end here

    @property
    def missed(self) -> int:
        """Colour images so far whose number never came."""
        return self._count.missed

    def close(self) -> None:
        """Stop the camera."""
        self._closed.set()
        with suppress(self._fails):  # unplugged
            self._stops.close()

    @contextmanager
    def _starting(self, complaint: str, mend: str = "") -> Iterator[None]:
        """Close the camera where it does not start; what the package says is one line then."""
        try:
            yield
        except self._fails as error:
            self.close()
            raise DatasetError(f"{complaint}: {error}{mend}") from error
        except BaseException:
            self.close()
            raise
