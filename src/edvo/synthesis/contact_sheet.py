"""A picture of all scenes, to choose one from."""

from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np

from edvo.errors import OutputError
from edvo.files import write_atomically
from edvo.synthesis.sequence import DEFAULT_CAMERA, SyntheticSource, make_recipe

_WIDTH, _HEIGHT, _LABEL, _ACROSS = 216, 162, 24, 5


def contact_sheet(
    scenes: Sequence[str], path: Path, advance: Callable[[], None] | None = None
) -> None:
    """Draw a thumbnail of each scene with its name below.

    Parameters
    ----------
    scenes : sequence of str
        Names or files.
    path : path
        Where to write the PNG image.
    advance : callable, optional
        Called after each scene.

    Raises
    ------
    SceneError
        If there is no such scene.
    OutputError
        If the image cannot be written.
    """
    down = -(-len(scenes) // _ACROSS)
    sheet = np.full((down * (_HEIGHT + _LABEL), _ACROSS * _WIDTH, 3), 255, np.uint8)
    eye = DEFAULT_CAMERA.scaled(_WIDTH / DEFAULT_CAMERA.width)
    for k, scene in enumerate(scenes):
        row, column = divmod(k, _ACROSS)
        top, left = row * (_HEIGHT + _LABEL), column * _WIDTH
        source = SyntheticSource(make_recipe(scene, frames=46, camera=eye, noise=False))
        sheet[top : top + _HEIGHT, left : left + _WIDTH] = source.colour(45)[:, :, ::-1]
        cv2.putText(
            sheet,
            source.name,
            (left + 8, top + _HEIGHT + 17),
            cv2.FONT_HERSHEY_SIMPLEX,
            0.5,
            (0, 0, 0),
            1,
            cv2.LINE_AA,
        )
        if advance is not None:
            advance()
    done, data = cv2.imencode(".png", sheet, [cv2.IMWRITE_PNG_COMPRESSION, 9])
    if not done:
        raise OutputError(f"cannot encode {path}; give a name that ends in .png")
    write_atomically(path, data.tobytes())
