"""Any folder of colour and depth images with a camera file.

::

    rgb/ (or color, colour, image, images, img)    colour
    depth/                                         16-bit depth, registered to colour
    camera.yaml                                    the camera with its depth scale
    groundtruth.txt                                optional, TUM rows

The names tell which images belong together: the same last number or the same name, or times in
seconds with a decimal point, or in whole milli-, micro- or nanoseconds since 1970. Lists as in
TUM's layout, such as color.txt and depth.txt, tell it too.
"""

from pathlib import Path

from edvo.datasets.known_cameras import choose_camera
from edvo.datasets.listed import CameraChoice, pair_source
from edvo.datasets.names import NO_TIMES, find_folders, images_in, pair_by_name
from edvo.datasets.source import Source
from edvo.datasets.tum import (
    COLOUR_LIST,
    DEPTH_LIST,
    GROUND_TRUTH,
    OTHER_COLOUR_LISTS,
    Listed,
    read_lists,
    read_truth,
)
from edvo.errors import DatasetError

COLOUR_FOLDERS = ("rgb", "color", "colour", "images", "image", "img")

# In the README of `edvo.synthesis.sequence.write_sequence`, and of an earlier run of it.
_SYNTHETIC = b"TUM RGB-D layout; camera.yaml holds the camera"
_README_BYTES = 10_000


class GenericFormat:
    """The registry's entry for any folder of images; asked last."""

    name = "folder"
    layout = "a folder with rgb/, depth/ and camera.yaml"

    def recognise(self, path: Path) -> str | None:
        """Say which lists or folders are there."""
        lists = _lists(path)
        if lists is not None:
            return " and ".join(lists)
        if _is_unfinished(path):
            return None
        folders = find_folders(path, COLOUR_FOLDERS)
        return None if folders is None else " and ".join(f"{each.name}/" for each in folders)

    def open(self, path: Path, *, camera: CameraChoice = None) -> Source:
        """Open a folder."""
        listed = _read(path)
        return pair_source(
            path,
            listed.pairs,
            format=self.name,
            recognised_by=self.recognise(path),
            camera=choose_camera(path, camera),
            truth=lambda: read_truth(path / GROUND_TRUTH, listed),
            warnings=listed.warnings,
        )


def _lists(path: Path) -> tuple[str, str] | None:
    if not (path / DEPTH_LIST).is_file():
        return None
    colour = next((name for name in OTHER_COLOUR_LISTS if (path / name).is_file()), None)
    return None if colour is None else (colour, DEPTH_LIST)


def _read(path: Path) -> Listed:
    lists = _lists(path)
    if lists is not None:
        return read_lists(path, colour_list=lists[0])
    folders = find_folders(path, COLOUR_FOLDERS)
    if folders is None:
        raise DatasetError(
            f"{path}: there is no rgb/ or no depth/; give {GenericFormat.layout}, "
            f"or lists ({OTHER_COLOUR_LISTS[0]} and {DEPTH_LIST})"
        )
    paired = pair_by_name(images_in(folders[0]), images_in(folders[1]), path)
    warnings = paired.warnings if paired.timed else (NO_TIMES, *paired.warnings)
    # Numbered poses go with numbered frames.
    listed = Listed(paired.pairs, not paired.timed, paired.alone, warnings)
    truth, _ = read_truth(path / GROUND_TRUTH, listed)
    if truth is not None and not paired.timed and truth.timestamps[0] > paired.pairs[-1].time:
        raise DatasetError(
            f"{path}: {GROUND_TRUTH} has times ({truth.stamps[0]} ...) but the images only have "
            f"numbers; give the lists {COLOUR_LIST} and {DEPTH_LIST}, or remove {GROUND_TRUTH}"
        )
    return listed


def _is_unfinished(path: Path) -> bool:
    """Say whether `edvo synth` began this folder anew: its lists, which it writes last, miss."""
    try:
        with (path / "README.txt").open("rb") as opened:
            return _SYNTHETIC in opened.read(_README_BYTES)
    except OSError:
        return False
