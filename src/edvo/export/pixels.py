"""What COLMAP and nerfstudio share: pixel coordinates from a corner, and names of images."""

from collections.abc import Sequence

from edvo.camera import Camera


def corner_principal_point(camera: Camera) -> tuple[float, float]:
    """Give the principal point counted from the corner of the image.

    Parameters
    ----------
    camera : Camera
        Here pixel centres are whole numbers; there the first one lies at (0.5, 0.5).

    Returns
    -------
    (float, float)
        Pixels.
    """
    return camera.cx + 0.5, camera.cy + 0.5


def image_names(stamps: Sequence[str]) -> list[str]:
    """Name the colour image of each frame, as TUM sequences do.

    Parameters
    ----------
    stamps : sequence of str
        Times as the source writes them.

    Returns
    -------
    list of str
        ``STAMP.png``.
    """
    return [f"{stamp}.png" for stamp in stamps]
