"""Which topics of a bag are colour and depth of one camera."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from edvo.datasets.images import compressed_size
from edvo.datasets.ros_bag import Bag
from edvo.datasets.ros_images import (
    is_16_bit_png,
    is_colour,
    is_compressed_depth,
    is_depth,
)
from edvo.datasets.ros_messages import (
    CAMERA_INFO,
    COMPRESSED_IMAGE,
    IMAGE,
    CameraInfo,
    parse_camera_info,
    parse_compressed_image,
    parse_image,
)
from edvo.datasets.ros_storage import Topic
from edvo.errors import DatasetError

_TRANSPORTS = ("compressed", "compressedDepth")
_MESSAGES_TRIED = 5

# Words in the names of topics, those that count most last.
_COLOUR_WORDS = ("image", "rgb", "colour", "color")
_NO_COLOUR = ("infra", "ir", "depth", "mask", "label", "debug", "confidence", "disparity")
_REGISTERED = ("registered", "aligned", "to_rgb", "to_color")


@dataclass(frozen=True)
class ImageTopic:
    """What the first good message of a topic of images tells.

    Attributes
    ----------
    topic : Topic
        The topic.
    holds : {"colour", "depth"} or None
        None if it is neither, or no message is good.
    encoding : str
        As the message says.
    size : (int, int) or None
        Width and height; None if only decoding would tell.
    frame_id : str
        Of the camera, empty if the driver wrote none.
    problem : str
        Why it is neither, for people.
    """

    topic: Topic
    holds: Literal["colour", "depth"] | None
    encoding: str = ""
    size: tuple[int, int] | None = None
    frame_id: str = ""
    problem: str = ""

    @property
    def name(self) -> str:
        """Name of the topic."""
        return self.topic.name

    @property
    def base(self) -> str:
        """The name without what image_transport appends."""
        head, _, last = self.name.rpartition("/")
        return head if last in _TRANSPORTS else self.name

    @property
    def is_float(self) -> bool:
        """Whether depth is in metres rather than in whole millimetres."""
        return "32fc1" in self.encoding.lower()


def choose_topics(
    bag: Bag, colour: str | None = None, depth: str | None = None
) -> tuple[ImageTopic, ImageTopic]:
    """Settle which topics are colour and depth.

    Parameters
    ----------
    bag : Bag
        Where they are.
    colour, depth : str, optional
        Names of topics, instead of guesses.

    Returns
    -------
    colour, depth : ImageTopic
        Both of the kind wanted. Guessed by what the images are, then by what is one camera: the
        same frame, the same size, names that begin alike; then by the words in the names.

    Raises
    ------
    DatasetError
        If there is none, a name is wrong, or several are equally good; the message lists them.
    """
    images = [topic for topic in bag.topics if topic.type in (IMAGE, COMPRESSED_IMAGE)]
    colours = _candidates(bag, images, "colour", colour)
    depths = _candidates(bag, images, "depth", depth)
    pairs = [(_suits(c, d), c, d) for c in colours for d in depths]
    pairs.sort(key=lambda pair: pair[0], reverse=True)
    best, chosen_colour, chosen_depth = pairs[0]
    for rating, other_colour, other_depth in pairs[1:2]:
        if rating == best:
            raise DatasetError(
                f"{bag.path}: topics {chosen_colour.name} with {chosen_depth.name} are as good as "
                f"{other_colour.name} with {other_depth.name}; choose by --colour-topic and "
                "--depth-topic"
            )
    return chosen_colour, chosen_depth


def find_camera_info(bag: Bag, image: ImageTopic) -> tuple[str, CameraInfo] | None:
    """Find the camera_info that goes with images.

    Parameters
    ----------
    bag : Bag
        Where to look.
    image : ImageTopic
        The topic of the images.

    Returns
    -------
    (str, CameraInfo) or None
        Its topic and first good message: of the topic beside the images, as image_transport
        has it, else of the only one of the same frame and size.
    """
    infos = {
        topic.name: info
        for topic in bag.topics
        if topic.type == CAMERA_INFO and (info := _first_info(bag, topic)) is not None
    }
    folder = image.base.rpartition("/")[0]
    # The last is where RealSense's recorder puts it.
    for name in (
        f"{folder}/camera_info",
        f"{image.base}/camera_info",
        f"{folder.rpartition('/')[0]}/info/camera_info",
    ):
        if name in infos:
            return name, infos[name]
    alike = [
        (name, info)
        for name, info in infos.items()
        if info.header.frame_id == image.frame_id
        and image.size in (None, (info.width, info.height))
    ]
    return alike[0] if len(alike) == 1 else None


def check_registration(
    bag: Bag, colour: ImageTopic, depth: ImageTopic, colour_info: CameraInfo | None
) -> list[str]:
    """Look whether depth is in the view of the colour camera.

    Parameters
    ----------
    bag : Bag
        Where both are.
    colour, depth : ImageTopic
        The topics chosen.
    colour_info : CameraInfo or None
        Of the colour camera.

    Returns
    -------
    list of str
        A warning if frame or intrinsics say that it is not.

    Raises
    ------
    DatasetError
        If the sizes differ, so that it cannot be.
    """
    mend = "record the registered depth (aligned_depth_to_color, depth_registered)"
    if None not in (colour.size, depth.size) and colour.size != depth.size:
        raise DatasetError(
            f"{bag.path}: {depth.name} is {_text(depth.size)} and {colour.name} is "
            f"{_text(colour.size)}: depth is not registered to colour; {mend}, or choose it by "
            "--depth-topic"
        )
    if colour.frame_id and depth.frame_id and colour.frame_id != depth.frame_id:
        return [
            f"{depth.name} is of frame {depth.frame_id} and {colour.name} of {colour.frame_id}: "
            f"depth is most likely not registered to colour; {mend}"
        ]
    found = find_camera_info(bag, depth)
    if colour_info is None or found is None or not found[1].intrinsics[0]:
        return []
    name, info = found
    differences = [abs(a - b) for a, b in zip(info.intrinsics, colour_info.intrinsics, strict=True)]
    if max(differences) > 0.02 * colour_info.intrinsics[0]:
        return [
            f"{name} has other intrinsics (fx {info.intrinsics[0]:.1f}) than the colour camera's "
            f"(fx {colour_info.intrinsics[0]:.1f}): depth is most likely not registered to colour; "
            f"{mend}"
        ]
    return []


def _candidates(
    bag: Bag, images: Sequence[Topic], wanted: Literal["colour", "depth"], named: str | None
) -> list[ImageTopic]:
    """List the topics that hold what is wanted; there is at least one."""
    option = f"--{wanted}-topic"
    if named is None:
        looked_at = [_look(bag, topic) for topic in images]
        good = [image for image in looked_at if image.holds == wanted]
        if not good:
            seen = "; ".join(
                f"{image.name}: {image.problem or image.encoding}" for image in looked_at
            )
            raise DatasetError(
                f"{bag.path}: no topic holds {wanted} images ({seen or 'no topic of images'}); "
                "record one"
            )
        return good
    name = named if named.startswith("/") else f"/{named}"
    topics = [topic for topic in bag.topics if topic.name in (named, name)]
    if not topics:
        names = ", ".join(topic.name for topic in images) or "none"
        raise DatasetError(f"{bag.path}: no topic {named} for {option}; topics of images: {names}")
    found = [_look(bag, topic) for topic in topics if topic.type in (IMAGE, COMPRESSED_IMAGE)]
    if not found:
        raise DatasetError(
            f"{bag.path}: {named} is {topics[0].type}, no image; give another {option}"
        )
    if found[0].holds != wanted:
        reason = found[0].problem or f"holds {found[0].holds} ({found[0].encoding})"
        raise DatasetError(f"{bag.path}: {named} {reason}; give another {option}")
    return found


def _look(bag: Bag, topic: Topic) -> ImageTopic:
    """Look at the first messages of a topic of images, until one is good."""
    try:
        places = bag.first(topic.name, _MESSAGES_TRIED)
    except DatasetError as error:
        return ImageTopic(topic, None, problem=str(error))
    problem = "has no message"
    for place in places:
        try:
            return _describe(bag, topic, bag.read(place))
        except DatasetError as error:
            problem = f"cannot be read: {error}"
    return ImageTopic(topic, None, problem=problem)


def _describe(bag: Bag, topic: Topic, data: bytes) -> ImageTopic:
    holds: Literal["colour", "depth"] | None = None
    if topic.type == IMAGE:
        raw = parse_image(data, bag.ros2)
        if not (raw.width and raw.height and len(raw.data)):
            raise DatasetError("its images are empty")
        holds = "depth" if is_depth(raw.encoding) else "colour" if is_colour(raw.encoding) else None
        problem = "" if holds else f"has encoding '{raw.encoding}', which edvo does not read"
        size: tuple[int, int] | None = (raw.width, raw.height)
        return ImageTopic(topic, holds, raw.encoding, size, raw.header.frame_id, problem)
    packed = parse_compressed_image(data, bag.ros2)
    if not len(packed.data):
        raise DatasetError("its images are empty")
    in_transport = is_compressed_depth(packed)
    holds = "depth" if in_transport or is_16_bit_png(packed.data) else "colour"
    size = compressed_size(packed.data[12:] if in_transport else packed.data)
    return ImageTopic(topic, holds, packed.format, size, packed.header.frame_id)


def _first_info(bag: Bag, topic: Topic) -> CameraInfo | None:
    try:
        for place in bag.first(topic.name, 1):
            return parse_camera_info(bag.read(place), bag.ros2)
    except DatasetError:
        pass
    return None


def _suits(colour: ImageTopic, depth: ImageTopic) -> tuple[float, ...]:
    """Rate how well two topics are colour and registered depth of one camera."""
    common = 0
    for a, b in zip(colour.base.split("/"), depth.base.split("/"), strict=False):
        if a != b:
            break
        common += 1
    words = _words(colour.name)
    return (
        not words.intersection(_NO_COLOUR),
        colour.size == depth.size or None in (colour.size, depth.size),
        colour.frame_id == depth.frame_id,
        any(word in depth.name for word in _REGISTERED),
        common,
        max((i for i, word in enumerate(_COLOUR_WORDS) if word in words), default=-1),
        "rect" in words,
        # Raw costs less to read than compressed, but recorders often keep only some of the raw.
        -abs(colour.topic.count - depth.topic.count) // max(colour.topic.count, 1),
        colour.topic.type == IMAGE,
        depth.topic.type == IMAGE,
    )


def _words(name: str) -> set[str]:
    return set(name.lower().replace("/", " ").replace("_", " ").split())


def _text(size: tuple[int, int] | None) -> str:
    return "x".join(map(str, size or ()))
