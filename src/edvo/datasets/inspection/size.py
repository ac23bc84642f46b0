"""Whether the camera is that of images of this size."""

from edvo.camera import Camera
from edvo.datasets.inspection.finding import Finding


def wrong_size(size: tuple[int, int], camera: Camera) -> Finding:
    """Say that images are of another size than the camera's, and the mend.

    Parameters
    ----------
    size : (int, int)
        Width and height of the images, pixels.
    camera : Camera
        Of another size.

    Returns
    -------
    Finding
    """
    width, height = size
    factor = f"{width / camera.width:g}"
    scaled = [round(side * float(factor)) for side in (camera.width, camera.height)]
    mend = f", or scale it with them: Camera.scaled({factor})" if scaled == [width, height] else ""
    warning = (
        f"images are {width} x {height}, the camera is for {camera.width} x {camera.height}: "
        f"give the camera of these images{mend}"
    )
    return Finding("size of images", (warning,))
