"""The exceptions that edvo raises.

Each message is one line that names the file or key at fault and the mend, so that a command can
print it as it is.
"""


class EdvoError(Exception):
    """Base of everything that edvo raises on purpose."""


class FrameError(EdvoError):
    """Images that cannot be a frame: wrong shape, wrong type, sizes that differ."""


class ImageSizeError(FrameError):
    """Images of another size than the camera's.

    Parameters
    ----------
    message : str
        What is wrong, and the mend.
    size : (int, int)
        Width and height of the images, pixels; (0, 0), the default, where they are not known.
    """

    def __init__(self, message: str, size: tuple[int, int] = (0, 0)) -> None:
        super().__init__(message)
        self.size = size


class NoDepthError(FrameError):
    """A depth image without a single valid pixel."""


class CameraError(EdvoError):
    """A camera that cannot be: a missing key, a value that is no number, an impossible size."""


class ConfigError(EdvoError):
    """An unknown key, a value out of range, or an unreadable configuration file."""


class DatasetError(EdvoError):
    """A source that is missing, empty, or of no known format."""


class TrajectoryError(EdvoError):
    """A trajectory file that cannot be read, or poses that are no rigid motions."""


class EvaluationError(EdvoError):
    """Trajectories that cannot be compared: nothing in common in time, too few poses."""


class SceneError(EdvoError):
    """A scene, light, sensor or motion that does not exist or cannot be rendered."""


class OutputError(EdvoError):
    """A result that cannot be written: no rights, no room, a folder in the way."""


class MissingExtraError(EdvoError):
    """An optional package is needed and not installed; the message names the extra."""
