"""Cameras in JSON files."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from edvo.camera import Camera
from edvo.datasets.text_files import read_text
from edvo.errors import CameraError, DatasetError


def read_json(file: Path) -> Any:
    """Read a JSON file.

    Parameters
    ----------
    file : pathlib.Path
        The file.

    Returns
    -------
    Any
        What it holds.

    Raises
    ------
    DatasetError
        If it cannot be read or is none; the message names it.
    """
    text = read_text(file, "it must be JSON")
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise DatasetError(f"{file} is no JSON: {error}; correct it") from error


def camera_of(file: Path, build: Callable[[Any], Camera]) -> Camera:
    """Make a camera of a JSON file.

    Parameters
    ----------
    file : pathlib.Path
        The file.
    build : callable
        Makes the camera of what the file holds.

    Returns
    -------
    Camera
        The camera.

    Raises
    ------
    DatasetError
        If the file is no JSON.
    CameraError
        If something is missing in it or cannot be; the message names it.
    """
    content = read_json(file)
    if not isinstance(content, dict):
        raise CameraError(f"{file} is no camera: it has no keys; correct it, or give --camera FILE")
    try:
        return build(content)
    except CameraError as error:
        raise CameraError(f"{file}: {error}") from error
    except KeyError as error:
        raise CameraError(f"{file}: {error} is missing; add it, or give --camera FILE") from error
    except (AttributeError, IndexError, TypeError, ValueError) as error:
        raise CameraError(f"{file} is no camera: {error}; give --camera FILE") from error
