"""ROS bags: ROS 1, and ROS 2 with sqlite3 or mcap files.

Colour and depth are paired by the stamps in their headers, which say when an image was taken and
not when it was recorded. The bag is gone through once, for its stamps; after that each image is
read from its place, by any thread.
"""

import os
import weakref
from dataclasses import replace
from pathlib import Path

from edvo.camera import Camera
from edvo.datasets.association import MAX_DIFFERENCE_S, associate
from edvo.datasets.images import make_frame
from edvo.datasets.known_cameras import KNOWN_CAMERAS, choose_camera, recognise_camera
from edvo.datasets.listed import CameraChoice, ListedSource
from edvo.datasets.ros_bag import Bag
from edvo.datasets.ros_camera import camera_from_info
from edvo.datasets.ros_messages import IMAGE, CameraInfo
from edvo.datasets.ros_stamped import load_colour, load_depth, seconds, stamp_text, stamp_topic
from edvo.datasets.ros_topics import (
    ImageTopic,
    check_registration,
    choose_topics,
    find_camera_info,
)
from edvo.datasets.source import Source
from edvo.errors import DatasetError
from edvo.frame import Frame

MILLIMETRES = 1000.0
"""Depth value of one metre in 16UC1 images (REP 118)."""

_BEGINNINGS = {
    b"#ROSBAG V": "a ROS 1 bag",
    b"\x89MCAP0\r\n": "an mcap file",
    b"SQLite format 3\x00": "an SQLite file",
}
_METADATA = b"rosbag2_bagfile_information"
_ENDINGS = (".bag", ".mcap", ".db3")
# Colour images without depth are usual up to about this share; beyond it, it is said.
_USUAL_LOSS = 0.1
# The drivers' defaults (525 for every Kinect) are further from a calibration than this.
_SAME_CAMERA = 0.005


class RosFormat:
    """The registry's entry for ROS bags."""

    name = "ros"
    layout = "a ROS 1 .bag file, or a ROS 2 bag: its folder, or one .mcap or .db3 file"

    def recognise(self, path: Path) -> str | None:
        """Say by which file it is a bag."""
        if path.is_dir():
            if _starts(path / "metadata.yaml").startswith(_METADATA):
                return "metadata.yaml"
            files = sorted(file for end in _ENDINGS[1:] for file in path.glob(f"*{end}"))
            return files[0].name if files else None
        if path.suffix.lower() not in _ENDINGS:
            return None
        beginning = _starts(path)
        kinds = [kind for start, kind in _BEGINNINGS.items() if beginning.startswith(start)]
        # A damaged file is best refused by the format that its name promises.
        return kinds[0] if kinds else f"the name ends in {path.suffix}"

    def open(
        self,
        path: Path,
        *,
        camera: CameraChoice = None,
        colour_topic: str | None = None,
        depth_topic: str | None = None,
    ) -> Source:
        """Open a bag; see `open_bag`."""
        return open_bag(path, camera=camera, colour_topic=colour_topic, depth_topic=depth_topic)


def open_bag(
    path: str | os.PathLike[str],
    *,
    camera: CameraChoice = None,
    colour_topic: str | None = None,
    depth_topic: str | None = None,
) -> ListedSource:
    """Open a ROS bag as a recording.

    Parameters
    ----------
    path : path-like
        A ROS 1 bag, a ROS 2 bag's folder, or one of its files.
    camera : Camera, path-like or str, optional
        Instead of what ``camera_info`` says. Its ``depth_scale`` holds for 16UC1 images, unless
        it is a known camera by name, whose scale is that of other files.
    colour_topic, depth_topic : str, optional
        Names of topics, instead of guesses.

    Returns
    -------
    ListedSource
        Its frames: colour images that have a depth image within 20 ms.

    Raises
    ------
    DatasetError
        If it is no bag, damaged, or has no topics that make frames, or nothing tells the camera.
    CameraError
        If the camera file is wrong.
    MissingExtraError
        If rosbags is not installed.

    Examples
    --------
    >>> source = open_bag("my.bag", depth_topic="/camera/depth_registered")  # doctest: +SKIP
    """
    # Absolute, for "." to have a name; links are kept, since the name may tell the camera.
    place = Path(os.path.abspath(path))  # noqa: PTH100
    if not place.exists():
        raise DatasetError(f"{path}: no such file or folder; check the path")
    bag = Bag(place)
    try:
        source = _open(bag, camera, colour_topic, depth_topic)
    except BaseException:
        bag.close()
        raise
    weakref.finalize(source, bag.close)
    return source


def _open(
    bag: Bag, camera: CameraChoice, colour_topic: str | None, depth_topic: str | None
) -> ListedSource:
    colour, depth = choose_topics(bag, colour_topic, depth_topic)
    found = find_camera_info(bag, colour)
    info = found[1] if found is not None else None
    taken, origin = _choose_camera(bag.path, camera, colour, depth, found)
    warnings = check_registration(bag, colour, depth, info)
    if camera is None and found is not None:
        warnings += _doubt_defaults(bag.path, taken, found[0])
    names = (colour.name, depth.name)
    stamped = [stamp_topic(bag, *each) for each in zip(names, bag.places(*names), strict=True)]
    have_stamps = all(each.has_stamps for each in stamped)
    if not have_stamps:
        warnings.append("headers have no stamps; times are those of recording")
        stamped = [each.by_recording() for each in stamped]
    for each in stamped:
        warnings += each.warnings
    colours, depths = (each.in_order(warnings) for each in stamped)
    base = int(colours.stamps[0])
    kept, partners = associate(seconds(colours.stamps, base), seconds(depths.stamps, base))
    within = f"within {MAX_DIFFERENCE_S * 1e3:g} ms"
    if not len(kept):
        raise DatasetError(
            f"{bag.path}: no image of {colour.name} ({colours.span}) "
            f"has one of {depth.name} ({depths.span}) "
            f"{within}; choose by --colour-topic and --depth-topic"
        )
    missing = len(colours.stamps) - len(kept)
    if missing > _USUAL_LOSS * len(colours.stamps):
        warnings.append(
            f"{missing} of {len(colours.stamps)} colour images have no depth image {within}: "
            "left out"
        )
    stamps = [stamp_text(stamp) for stamp in colours.stamps[kept]]
    pairs = [(colours.places[i], depths.places[j]) for i, j in zip(kept, partners, strict=True)]
    delays = seconds(depths.stamps[partners] - colours.stamps[kept], 0) * have_stamps

    def load(index: int) -> Frame:
        at = f"at {stamps[index]} in {bag.path}"
        first, second = pairs[index]
        names = f"{colour.name} {at}", f"{depth.name} {at}"
        grey = load_colour(bag, first, colour.topic.type == IMAGE, names[0])
        return make_frame(
            float(stamps[index]),
            (names[0], grey),
            (names[1], load_depth(bag, second, depth.topic.type == IMAGE, names[1])),
            taken,
            float(delays[index]),
        )

    return ListedSource(
        bag.path,
        format=RosFormat.name,
        recognised_by=RosFormat().recognise(bag.path),
        stamps=stamps,
        times=[float(stamp) for stamp in stamps],
        load=load,
        camera=(taken, origin),
        warnings=warnings,
        facts={
            "bag": bag.kind,
            "colour_topic": f"{colour.name} ({colour.encoding})",
            "depth_topic": f"{depth.name} ({depth.encoding})",
            "colour_images_without_depth": missing,
        },
    )


def _choose_camera(
    path: Path,
    camera: CameraChoice,
    colour: ImageTopic,
    depth: ImageTopic,
    found: tuple[str, CameraInfo] | None,
) -> tuple[Camera, str]:
    scale = 1.0 if depth.is_float else MILLIMETRES

    def stated() -> tuple[Camera, str]:
        if found is not None:
            name, info = found
            # image_proc appends _rect to the names of what it rectifies.
            rectified = "rect" in colour.base.rpartition("/")[2].lower().split("_")
            taken = camera_from_info(
                info, rectified=rectified, depth_scale=scale, name=f"{path}: {name}"
            )
            return taken, name
        known = recognise_camera(path)
        if known is None:
            raise DatasetError(
                f"{path}: no camera_info goes with {colour.name}; record it or add --camera FILE"
            )
        return known[0], f"recognised as {known[0].name} by the name '{known[1]}'"

    taken, origin = choose_camera(path, camera, stated=stated)
    # A bag's own units win over those of the files that a known camera's numbers come with.
    if depth.is_float or taken in KNOWN_CAMERAS.values():
        taken = replace(taken, depth_scale=scale)
    if colour.size not in (None, (taken.width, taken.height)):
        width, height = colour.size or (0, 0)
        raise DatasetError(
            f"{path}: images of {colour.name} are {width}x{height} and the camera ({origin}) is "
            f"{taken.width}x{taken.height}; add --camera FILE with the camera of these images"
        )
    return taken, origin


def _doubt_defaults(path: Path, camera: Camera, topic: str) -> list[str]:
    """Warn where a bag of a known data set has the driver's defaults for a calibration."""
    known = recognise_camera(path)
    if known is None or abs(known[0].fx / camera.fx - 1.0) < _SAME_CAMERA:
        return []
    name = known[0].name
    return [
        f"{topic} has fx {camera.fx:.1f}, and '{known[1]}' sounds like {name} with fx "
        f"{known[0].fx:.1f}: if it is, add --camera {name}"
    ]


def _starts(file: Path) -> bytes:
    """Give the first bytes of a file, none if it cannot be read."""
    try:
        with file.open("rb") as opened:
            return opened.read(64)
    except OSError:
        return b""
