"""ROS bags: ROS 1, and ROS 2 with sqlite3 or mcap files.

Colour and depth are paired by the stamps in their headers, which say when an image was taken and
not when it was recorded. The bag is gone through once, for its stamps; after that each image is
read from its place, by any thread.
"""

import os
import weakref
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from edvo.camera import Camera
from edvo.datasets.association import MAX_DIFFERENCE_S, associate
from edvo.datasets.images import make_frame
from edvo.datasets.known_cameras import KNOWN_CAMERAS, choose_camera, recognise_camera
from edvo.datasets.listed import CameraChoice, ListedSource
from edvo.datasets.ros_bag import Bag, Place
from edvo.datasets.ros_camera import camera_from_info
from edvo.datasets.ros_images import decompressed_colour, decompressed_depth, depth_of, grey_of
from edvo.datasets.ros_messages import (
    IMAGE,
    CameraInfo,
    parse_compressed_image,
    parse_image,
    parse_stamp,
)
from edvo.datasets.ros_topics import (
    ImageTopic,
    check_registration,
    choose_topics,
    find_camera_info,
)
from edvo.datasets.source import Source
from edvo.errors import DatasetError, FrameError
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
_NANOSECONDS = 10**9
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
    stamped = [_stamp(bag, *each) for each in zip(names, bag.places(*names), strict=True)]
    if not all(each.has_stamps for each in stamped):
        warnings.append("headers have no stamps; times are those of recording")
        stamped = [each.by_recording() for each in stamped]
    for each in stamped:
        warnings += each.warnings
    colours, depths = (each.in_order(warnings) for each in stamped)
    base = int(colours.stamps[0])
    kept, partners = associate(_seconds(colours.stamps, base), _seconds(depths.stamps, base))
    within = f"within {MAX_DIFFERENCE_S * 1e3:g} ms"
    if not len(kept):
        raise DatasetError(
            f"{bag.path}: no image of {colour.name} ({_text(base)} to {_text(colours.stamps[-1])}) "
            f"has one of {depth.name} ({_text(depths.stamps[0])} to {_text(depths.stamps[-1])}) "
            f"{within}; choose by --colour-topic and --depth-topic"
        )
    missing = len(colours.stamps) - len(kept)
    if missing > _USUAL_LOSS * len(colours.stamps):
        warnings.append(
            f"{missing} of {len(colours.stamps)} colour images have no depth image {within}: "
            "left out"
        )
    stamps = [_text(stamp) for stamp in colours.stamps[kept]]
    pairs = [(colours.places[i], depths.places[j]) for i, j in zip(kept, partners, strict=True)]

    def load(index: int) -> Frame:
        at = f"at {stamps[index]} in {bag.path}"
        first, second = pairs[index]
        names = f"{colour.name} {at}", f"{depth.name} {at}"
        grey = _load_colour(bag, first, colour, names[0])
        return make_frame(
            float(stamps[index]),
            (names[0], grey),
            (names[1], _load_depth(bag, second, depth, names[1])),
            taken,
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


@dataclass(frozen=True)
class _Stamped:
    """The messages of a topic, with their times in nanoseconds."""

    name: str
    places: Sequence[Place]
    stamps: NDArray[np.int64]
    warnings: tuple[str, ...] = ()

    @property
    def has_stamps(self) -> bool:
        return bool(self.stamps.any())

    def by_recording(self) -> "_Stamped":
        recorded = np.array([place.recorded for place in self.places], np.int64)
        return replace(self, stamps=recorded)

    def in_order(self, warnings: list[str]) -> "_Stamped":
        back = int(np.count_nonzero(np.diff(self.stamps) < 0))
        if back:
            warnings.append(f"{self.name}: {back} images go back in time: sorted")
        stamps, order = np.unique(self.stamps, return_index=True)
        again = len(self.stamps) - len(stamps)
        if again:
            warnings.append(f"{self.name}: {again} images repeat a time: left out")
        return replace(self, stamps=stamps, places=[self.places[i] for i in order])


def _stamp(bag: Bag, topic: str, places: Sequence[Place]) -> _Stamped:
    """Take the stamps of all messages; those without a readable one are left out."""
    good: list[Place] = []
    stamps: list[int] = []
    problems: list[str] = []
    for place in places:
        try:
            stamps.append(parse_stamp(place.head, bag.ros2))
            good.append(place)
        except DatasetError as error:
            problems.append(str(error))
    if not good:
        reason = "; ".join(problems[:1]) or "there is none"
        raise DatasetError(f"{bag.path}: no message of {topic} can be read: {reason}")
    count = f"{len(problems)} of {len(places)}"
    return _Stamped(
        topic,
        good,
        np.array(stamps, np.int64),
        tuple(f"{topic}: {count} messages cannot be read: {text}" for text in problems[:1]),
    )


def _load_colour(bag: Bag, place: Place, image: ImageTopic, where: str) -> NDArray[np.uint8]:
    try:
        data = bag.read(place)
        if image.topic.type == IMAGE:
            return grey_of(parse_image(data, bag.ros2), where)
        return decompressed_colour(parse_compressed_image(data, bag.ros2), where)
    except DatasetError as error:
        raise FrameError(f"{where}: {error}") from error


def _load_depth(
    bag: Bag, place: Place, image: ImageTopic, where: str
) -> NDArray[np.uint16] | NDArray[np.float32]:
    try:
        data = bag.read(place)
        if image.topic.type == IMAGE:
            return depth_of(parse_image(data, bag.ros2), where)
        return decompressed_depth(parse_compressed_image(data, bag.ros2), where)
    except DatasetError as error:
        raise FrameError(f"{where}: {error}") from error


def _seconds(stamps: NDArray[np.int64], base: int) -> NDArray[np.float64]:
    """Convert to seconds from a near origin, where a double has nanoseconds."""
    return np.asarray((stamps - base) / _NANOSECONDS, np.float64)


def _text(stamp: int | np.int64) -> str:
    return f"{int(stamp) // _NANOSECONDS}.{int(stamp) % _NANOSECONDS:09d}"
