import copy
import doctest
import math
import pickle
from dataclasses import FrozenInstanceError, replace
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from numpy.typing import NDArray

from edvo import frame as frame_module
from edvo import se3
from edvo.camera import Camera
from edvo.errors import FrameError, NoDepthError
from edvo.frame import Frame, register_depth

GREY = np.arange(12, dtype=np.uint8).reshape(3, 4)
COLOUR = np.arange(36, dtype=np.uint8).reshape(3, 4, 3) * 7
DEPTH = np.full((3, 4), 1.5, np.float32)
MILLIMETRES = np.full((3, 4), 1500, np.uint16)

DEPTH_CAMERA = Camera(160, 120, 145.0, 146.0, 78.0, 61.0, (0.05, -0.1, 0.001, -0.001, 0.0))
COLOUR_CAMERA = Camera(324, 242, 292.0, 293.0, 160.0, 122.0, (0.1, -0.2, -0.001, 0.002, 0.05))
PINHOLE = Camera(160, 120, 145.0, 145.0, 79.5, 59.5)
# Of a structured-light sensor: 25 mm beside each other, and not quite parallel.
RIG = se3.exp(np.array([0.025, 0.002, -0.003, 0.004, -0.006, 0.01]))


def plane_depth(
    camera: Camera, normal: NDArray[np.float64], distance: float
) -> NDArray[np.float32]:
    """Depth of the plane normal . p = distance, seen by a camera, analytically."""
    u, v = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    pixels = np.column_stack((u.ravel(), v.ravel()))
    rays = camera.backproject(pixels, np.ones(u.size))
    return (distance / (rays @ normal)).reshape(u.shape).astype(np.float32)


# --- the door ----------------------------------------------------------------------------------


def test_a_good_frame_is_kept_as_it_is() -> None:
    frame = Frame(12.5, GREY, DEPTH)
    for image, source in ((frame.grey, GREY), (frame.depth, DEPTH)):
        assert np.shares_memory(image, source)
        assert not image.flags.writeable  # or compiled code would be compiled once more
        assert source.flags.writeable
    assert frame.timestamp == 12.5
    with pytest.raises(FrozenInstanceError):
        frame.timestamp = 0.0  # type: ignore[misc]
    assert type(Frame(np.float64(3), GREY, DEPTH).timestamp) is float
    assert type(Frame(3, GREY, DEPTH).timestamp) is float
    assert Frame(np.array(3.5), GREY, DEPTH).timestamp == 3.5


@pytest.mark.parametrize("turn", [np.rot90, np.transpose, np.asfortranarray, np.flipud])
def test_images_of_a_camera_that_is_mounted_otherwise_are_taken(turn: Any) -> None:
    for flat in (MILLIMETRES, DEPTH, DEPTH.astype(np.float64)):
        depth = flat * np.arange(1, 13).reshape(3, 4).astype(flat.dtype)
        colour = COLOUR.swapaxes(0, 1) if turn is np.transpose else turn(COLOUR)
        frame = Frame.from_images(0.0, colour, turn(depth))
        upright = Frame.from_images(0.0, COLOUR, depth)
        np.testing.assert_array_equal(frame.depth, turn(upright.depth))
        np.testing.assert_array_equal(frame.grey, turn(upright.grey))


@pytest.mark.parametrize("again", [pickle.dumps, copy.deepcopy, copy.copy, Frame.kept])
def test_no_copy_can_be_written_to(again: Any) -> None:
    """Or the next step of a tracker would wait for the compiler."""
    other = again(Frame(1.0, GREY.copy(), DEPTH.copy(), 0.25))
    other = pickle.loads(other) if again is pickle.dumps else other
    assert (other.timestamp, other.depth_delay) == (1.0, 0.25)
    for image, source in ((other.grey, GREY), (other.depth, DEPTH)):
        assert not image.flags.writeable
        np.testing.assert_array_equal(image, source)


@pytest.mark.parametrize("seconds", [math.nan, math.inf, "x", None])
def test_the_delay_of_depth_is_a_number(seconds: Any) -> None:
    with pytest.raises(FrameError, match=r"depth_delay is .*; give finite seconds"):
        Frame(1.0, GREY, DEPTH).delayed(seconds)
    with pytest.raises(FrameError, match=r"depth_delay is .*; give finite seconds"):
        Frame(1.0, GREY, DEPTH, seconds)


def test_a_time_that_no_float_holds_is_refused() -> None:
    with pytest.raises(FrameError, match=r"timestamp is 1000.*; give finite seconds"):
        Frame.from_images(10**400, COLOUR, MILLIMETRES)


@pytest.mark.parametrize("scale", ["x", None, 0, -1.0, math.nan, math.inf, 1e-40, 10**400])
def test_a_scale_of_depth_that_cannot_be_is_refused(scale: Any) -> None:
    with pytest.raises(FrameError, match=r"depth_scale is .*; give the depth value of one"):
        Frame.from_images(0.0, COLOUR, MILLIMETRES, depth_scale=scale)


def test_a_mask_is_not_passed_over() -> None:
    masked = np.ma.masked_less(DEPTH, 2.0)
    for make in (Frame, Frame.from_images):
        with pytest.raises(FrameError, match=r"depth is a masked array; give depth.filled\(0\)"):
            make(0.0, GREY, masked)


def test_images_that_somebody_may_write_to_are_copied_to_be_kept() -> None:
    grey, depth = GREY.copy(), DEPTH.copy()
    for make in (Frame, Frame.from_images):
        frame = make(1.5, grey, depth, depth_delay=-0.012)
        kept = frame.kept()
        grey += 1
        depth += 1
        np.testing.assert_array_equal(kept.grey, grey - 1)
        np.testing.assert_array_equal(kept.depth, depth - 1)
        assert not kept.grey.flags.writeable
        assert not kept.depth.flags.writeable
        assert (kept.timestamp, kept.depth_delay) == (1.5, -0.012)
        assert not frame.is_own
        assert kept.kept() is kept
        assert frame.kept() is kept  # copied once, whoever asks


def test_images_of_its_own_are_not_copied_to_be_kept() -> None:
    told = [make(0.0, GREY, DEPTH, is_own=True) for make in (Frame, Frame.from_images)]
    made = Frame.from_images(0.0, COLOUR, MILLIMETRES)
    for frame in (*told, made):
        assert frame.kept() is frame


@pytest.mark.parametrize(
    ("colour", "depth"),
    [
        (GREY, MILLIMETRES),
        (COLOUR, DEPTH),
        (GREY[:, :, None], MILLIMETRES),
        (COLOUR, DEPTH[:, :, None]),
    ],
)
def test_an_image_that_is_taken_as_it_is_belongs_to_its_maker(
    colour: NDArray[np.uint8], depth: NDArray[np.float32] | NDArray[np.uint16]
) -> None:
    assert not Frame.from_images(0.0, colour, depth).is_own


def test_read_only_images_are_taken() -> None:
    grey, depth = GREY.copy(), DEPTH.copy()
    grey.flags.writeable = depth.flags.writeable = False
    assert np.shares_memory(Frame(0.0, grey, depth).grey, grey)
    assert np.shares_memory(Frame.from_images(0.0, grey, depth).depth, depth)


BAD_FRAMES: list[tuple[Any, Any, Any, str]] = [
    (math.nan, GREY, DEPTH, "timestamp is nan; give finite seconds"),
    (math.inf, GREY, DEPTH, "timestamp is inf"),
    ("now", GREY, DEPTH, "timestamp is 'now'; give finite seconds"),
    (None, GREY, DEPTH, "timestamp is None"),
    ("1.5", GREY, DEPTH, "timestamp is '1.5'; give finite seconds"),
    (True, GREY, DEPTH, "timestamp is True"),
    (np.complex128(1), GREY, DEPTH, "timestamp is "),
    (np.array("1.5"), GREY, DEPTH, "timestamp is .*1.5"),
    (np.array(True), GREY, DEPTH, "timestamp is "),
    (np.datetime64(1, "ns"), GREY, DEPTH, "timestamp is .*datetime64"),
    (0.0, None, DEPTH, "grey is NoneType; give a NumPy array"),
    (0.0, GREY, [[1.0]], "depth is list; give a NumPy array"),
    (
        0.0,
        COLOUR,
        DEPTH,
        r"grey is uint8 of shape \(3, 4, 3\); give uint8 of shape \(H, W\), or use",
    ),
    (0.0, GREY.astype(np.float32), DEPTH, "grey is float32 of shape .*; give uint8"),
    (0.0, GREY, MILLIMETRES, r"depth is uint16 .*; give float32 .*, or use Frame.from_images"),
    (0.0, GREY, DEPTH.astype(np.float64), "depth is float64"),
    (0.0, GREY[:, :2], DEPTH[:, :2], "grey is not C-contiguous; use Frame.from_images"),
    (0.0, GREY, np.asfortranarray(DEPTH), "depth is not C-contiguous"),
    (0.0, GREY[:0], DEPTH[:0], r"grey has shape \(0, 4\); give an image with pixels"),
    (0.0, GREY[:2], DEPTH, r"grey is 4x2 and depth 4x3; register depth .*register_depth"),
    (0.0, GREY, -DEPTH, r"depth has values from -1.5 to -1.5; give metres with 0 where missing"),
    (0.0, GREY, DEPTH * np.float32(np.nan), "depth has values from nan to nan"),
    (0.0, GREY, DEPTH * np.float32(np.inf), "depth has values from inf to inf"),
]


@pytest.mark.parametrize(("timestamp", "grey", "depth", "message"), BAD_FRAMES)
def test_bad_frames_are_refused_in_one_line(
    timestamp: Any, grey: Any, depth: Any, message: str
) -> None:
    with pytest.raises(FrameError, match=message) as caught:
        Frame(timestamp, grey, depth)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("value", [math.nan, math.inf, -1.0])
def test_one_bad_depth_pixel_is_enough(value: float) -> None:
    depth = DEPTH.copy()
    depth[1, 2] = value
    with pytest.raises(FrameError, match="depth has values from"):
        Frame(0.0, GREY, depth)
    cleaned = Frame.from_images(0.0, GREY, depth).depth
    assert cleaned[1, 2] == 0.0
    assert (cleaned == 1.5).sum() == 11
    assert depth[1, 2] != 0.0  # the caller's own array stays


@pytest.mark.parametrize("depth", [DEPTH * 0, -DEPTH, MILLIMETRES * 0, DEPTH * np.float32(np.nan)])
def test_no_depth_at_all_has_its_own_error(depth: NDArray[Any]) -> None:
    with pytest.raises(NoDepthError, match="depth has no valid value"):
        Frame.from_images(0.0, GREY, depth)


def test_the_delay_of_depth_is_kept() -> None:
    assert Frame(1.0, GREY, DEPTH).depth_delay == 0.0
    frame = Frame.from_images(1.0, COLOUR, MILLIMETRES, depth_delay=-0.012)
    assert frame.depth_delay == -0.012
    other = replace(frame, timestamp=2.0, grey=GREY)
    assert (other.timestamp, other.depth_delay) == (2.0, -0.012)
    assert type(Frame(1.0, GREY, DEPTH, np.float32(0.5)).depth_delay) is float  # type: ignore[arg-type]


@pytest.mark.parametrize("delay", [math.nan, math.inf, -math.inf, None, "late"])
def test_a_delay_that_is_no_time_is_refused_in_one_line(delay: Any) -> None:
    for make in (Frame, Frame.from_images):
        with pytest.raises(FrameError) as caught:
            make(1.0, GREY, DEPTH, depth_delay=delay)  # type: ignore[operator]
        assert str(caught.value) == f"depth_delay is {delay!r}; give finite seconds"


# --- what people have --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("colour", "order", "code"),
    [
        (COLOUR, "bgr", cv2.COLOR_BGR2GRAY),
        (COLOUR, "rgb", cv2.COLOR_RGB2GRAY),
        (np.dstack((COLOUR, GREY)), "bgr", cv2.COLOR_BGRA2GRAY),
        (np.dstack((COLOUR, GREY)), "rgb", cv2.COLOR_RGBA2GRAY),
        (COLOUR[:, ::-1], "bgr", cv2.COLOR_BGR2GRAY),
    ],
)
def test_colour_becomes_grey_as_opencv_makes_it(colour: Any, order: Any, code: int) -> None:
    frame = Frame.from_images(0.0, colour, DEPTH, order=order)
    np.testing.assert_array_equal(frame.grey, cv2.cvtColor(np.ascontiguousarray(colour), code))


def test_the_order_of_channels_matters() -> None:
    red = np.zeros((3, 4, 3), np.uint8)
    red[:, :, 0] = 255
    assert (Frame.from_images(0.0, red, DEPTH, order="rgb").grey == 76).all()  # 0.299 x 255
    assert (Frame.from_images(0.0, red, DEPTH, order="bgr").grey == 29).all()  # 0.114 x 255


def test_grey_is_taken_without_a_copy_where_that_can_be() -> None:
    assert np.shares_memory(Frame.from_images(0.0, GREY, DEPTH).grey, GREY)
    assert np.shares_memory(Frame.from_images(0.0, GREY[:, :, None], DEPTH).grey, GREY)
    assert np.shares_memory(Frame.from_images(0.0, GREY, DEPTH[:, :, None]).depth, DEPTH)
    flipped = Frame.from_images(0.0, GREY[::-1, ::-1], DEPTH[::-1])
    np.testing.assert_array_equal(flipped.grey, GREY[::-1, ::-1])
    assert flipped.grey.flags.c_contiguous


@pytest.mark.parametrize("dtype", ["<u2", ">u2"])
def test_depth_units(dtype: str) -> None:
    depth = np.array([[0, 1], [1000, 65535]]).astype(dtype)
    grey = np.zeros((2, 2), np.uint8)
    metres = Frame.from_images(0.0, grey, depth).depth
    np.testing.assert_allclose(metres, [[0, 0.001], [1, 65.535]], rtol=1e-7)
    assert metres.dtype == np.float32
    five = Frame.from_images(0.0, grey, depth, depth_scale=5000.0).depth
    np.testing.assert_allclose(five, [[0, 0.0002], [0.2, 13.107]], rtol=1e-7)


@pytest.mark.parametrize("dtype", [np.float32, np.float64, ">f4"])
def test_float_depth_is_metres_whatever_the_scale(dtype: Any) -> None:
    frame = Frame.from_images(0.0, GREY, DEPTH.astype(dtype), depth_scale=5000.0)
    np.testing.assert_array_equal(frame.depth, DEPTH)


@given(
    arrays.arrays(
        np.float64,
        (3, 4),
        elements=st.floats(allow_nan=True, allow_infinity=True) | st.floats(0.1, 10.0),
    )
)
def test_float_depth_of_any_value_is_cleaned(depth: NDArray[np.float64]) -> None:
    with np.errstate(over="ignore"):
        single = depth.astype(np.float32)
    valid = np.isfinite(single) & (single > 0.0)
    if not valid.any():
        with pytest.raises(NoDepthError):
            Frame.from_images(0.0, GREY, depth)
        return
    result = Frame.from_images(0.0, GREY, depth).depth
    np.testing.assert_array_equal(result, np.where(valid, single, 0.0))


BAD_IMAGES: list[tuple[Any, Any, dict[str, Any], str]] = [
    (COLOUR.astype(np.uint16), DEPTH, {}, "colour is uint16; give uint8"),
    (COLOUR / 255.0, DEPTH, {}, "colour is float64; give uint8"),
    (GREY > 3, DEPTH, {}, "colour is bool; give uint8"),
    (None, DEPTH, {}, r"colour is NoneType; give a NumPy array \(None: the file was not read\)"),
    (GREY, None, {}, "depth is NoneType"),
    (COLOUR[:, :, :2], DEPTH, {}, r"colour has shape \(3, 4, 2\); give \(H, W\), \(H, W, 3\)"),
    (COLOUR[None], DEPTH[None], {}, r"colour has shape \(1, 3, 4, 3\)"),
    (GREY[0], DEPTH[0], {}, r"colour has shape \(4,\)"),
    (GREY, DEPTH.astype(np.int32), {}, "depth is int32; give uint16 with depth_scale, or float32"),
    (GREY, DEPTH.astype(np.uint8), {}, "depth is uint8"),
    (GREY, DEPTH.astype(np.float16), {}, "depth is float16"),
    (GREY, np.dstack([DEPTH] * 3), {}, r"depth has shape \(3, 4, 3\); give \(H, W\)"),
    (GREY, MILLIMETRES, {"depth_scale": 0.0}, "depth_scale is 0.0; give the depth value of one"),
    (GREY, MILLIMETRES, {"depth_scale": math.nan}, "depth_scale is nan"),
    (COLOUR, DEPTH, {"order": "gbr"}, "order is 'gbr'; give 'bgr' or 'rgb'"),
    (COLOUR, DEPTH[:2], {}, "colour is 4x3 and depth 4x2; register depth .*register_depth"),
    (COLOUR[:0], DEPTH[:0], {}, "image with pixels"),
]


@pytest.mark.parametrize(("colour", "depth", "options", "message"), BAD_IMAGES)
def test_bad_images_are_refused_in_one_line(
    colour: Any, depth: Any, options: dict[str, Any], message: str
) -> None:
    with pytest.raises(FrameError, match=message) as caught:
        Frame.from_images(0.0, colour, depth, **options)
    assert "\n" not in str(caught.value)


# --- registering depth -------------------------------------------------------------------------


@pytest.mark.parametrize("camera", [PINHOLE, DEPTH_CAMERA, COLOUR_CAMERA])
def test_registering_to_itself_changes_nothing(camera: Camera) -> None:
    rng = np.random.default_rng(0)
    depth = rng.uniform(0.4, 8.0, (camera.height, camera.width)).astype(np.float32)
    depth[rng.random(depth.shape) < 0.2] = 0.0
    np.testing.assert_array_equal(register_depth(depth, camera, camera, np.eye(4)), depth)


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_missing_depth_stays_missing(dtype: Any) -> None:
    depth = np.full((120, 160), np.nan, dtype)
    depth[0, 0], depth[1, 1] = 0.0, np.inf
    depth[60, 80] = 2.0
    result = register_depth(depth, PINHOLE, PINHOLE, np.eye(4))
    assert result.dtype == np.float32
    assert np.count_nonzero(result) == 1
    assert result[60, 80] == 2.0


@pytest.mark.parametrize("roll", [0.0, math.pi / 4, math.pi / 2, math.pi])
@pytest.mark.parametrize("tilt", [(0.0, 0.0), (0.1, -0.15), (-0.5, 0.3)])
def test_a_plane_arrives_where_the_colour_camera_sees_it(
    roll: float, tilt: tuple[float, float]
) -> None:
    normal = np.array([*tilt, 1.0])
    T_colour_depth = se3.compose(se3.exp(np.array([0, 0, 0, 0, 0, roll])), RIG)
    depth = plane_depth(DEPTH_CAMERA, normal, 1.5)
    result = register_depth(depth, DEPTH_CAMERA, COLOUR_CAMERA, T_colour_depth)
    assert result.shape == (242, 324)
    # The plane n . p_d = d in the colour camera: (R n) . p_c = d + (R n) . t
    turned = T_colour_depth[:3, :3] @ normal
    distance = 1.5 + float(turned @ T_colour_depth[:3, 3])
    expected = plane_depth(COLOUR_CAMERA, turned, distance)

    # Which pixels the depth camera can know: their points project well inside its image.
    u, v = np.meshgrid(np.arange(324), np.arange(242))
    points = COLOUR_CAMERA.backproject(np.column_stack((u.ravel(), v.ravel())), expected.ravel())
    T = se3.inverse(T_colour_depth)
    pixels = DEPTH_CAMERA.project(points @ T[:3, :3].T + T[:3, 3])
    known = ((pixels >= 1) & (pixels <= [158, 118])).all(axis=1).reshape(242, 324)
    assert known.mean() > 0.4
    assert (result[known] > 0).mean() > 0.999
    hit = known & (result > 0)
    # Half a depth pixel off at most, so by the slope of the plane over that half at most.
    error = np.abs(result - expected)[hit]
    slope = np.abs(np.gradient(plane_depth(DEPTH_CAMERA, normal, 1.5))).max(axis=(1, 2)).sum()
    assert error.max() < 1e-3 + 0.8 * slope
    assert np.median(error) < 1e-3 + 0.3 * slope
    if tilt == (0.0, 0.0):
        assert error.max() < 1e-3


def test_nearer_surface_wins() -> None:
    depth = np.full((120, 160), 3.0, np.float32)
    depth[40:80, 60:100] = 1.0
    T = np.eye(4)
    T[0, 3] = 0.1  # the colour camera stands 0.1 m to the left: near things move right by 14.5 px
    result = register_depth(depth, PINHOLE, PINHOLE, T)
    row = result[60]
    assert (row[75:114] == 1.0).all()
    assert (row[116:] == 3.0).all()
    assert (row[5:64] == 3.0).all()
    # Behind its left side opens what the depth camera could not see: 14.5 - 4.8 px.
    assert 9 <= np.count_nonzero(row[60:80] == 0.0) <= 10
    assert set(np.unique(result)) <= {0.0, 1.0, 3.0}


def test_what_is_out_of_view_or_behind_is_dropped() -> None:
    depth = np.full((120, 160), 1.0, np.float32)
    aside = np.eye(4)
    aside[0, 3] = 10.0
    assert not register_depth(depth, PINHOLE, PINHOLE, aside).any()
    assert not register_depth(depth, PINHOLE, PINHOLE, np.diag([1.0, -1, -1, 1])).any()
    half = np.eye(4)
    half[0, 3] = 80 / 145.0  # by half an image
    result = register_depth(depth, PINHOLE, PINHOLE, half)
    assert not result[:, :79].any()
    assert (result[:, 81:] == 1.0).all()


def test_a_finer_colour_image_gets_no_holes_and_a_coarser_one_the_near_side() -> None:
    depth = np.full((120, 160), 2.0, np.float32)
    depth[:, 80:] = 1.0
    fine = register_depth(depth, PINHOLE, PINHOLE.scaled(2.7), np.eye(4))
    assert (fine > 0).all()
    assert (fine[:, :216] == 2.0).all()
    assert (fine[:, 216:] == 1.0).all()
    coarse = register_depth(depth, PINHOLE, PINHOLE.scaled(1 / 3), np.eye(4))
    assert coarse.shape == (40, 53)
    assert (coarse > 0).all()


def test_a_point_that_touches_the_colour_camera_does_not_cover_its_image() -> None:
    depth = np.zeros((120, 160), np.float32)
    depth[60, 80] = 1.0
    T = np.eye(4)
    T[2, 3] = -0.9999
    result = register_depth(depth, PINHOLE, PINHOLE, T)
    assert 0 < np.count_nonzero(result) <= 16 * 16


@pytest.mark.parametrize(
    ("depth", "T", "message"),
    [
        (MILLIMETRES, np.eye(4), "depth is uint16 4x3; register_depth wants metres"),
        (DEPTH, np.eye(4), "depth is float32 4x3; .* of the depth camera's 160x120"),
        (None, np.eye(4), "depth is NoneType"),
        (np.ones((120, 160)), np.eye(3), "T_colour_depth is no rigid motion; give a 4x4 matrix"),
        (np.ones((120, 160)), np.full((4, 4), np.nan), "T_colour_depth is no rigid motion"),
        (np.ones((120, 160)), np.ones((4, 4)), "T_colour_depth is no rigid motion"),
        (np.ones((120, 160)), "x", "T_colour_depth is no rigid motion"),
    ],
)
def test_bad_registrations_are_refused(depth: Any, T: Any, message: str) -> None:
    with pytest.raises(FrameError, match=message):
        register_depth(depth, PINHOLE, PINHOLE, T)


def test_examples() -> None:
    assert doctest.testmod(frame_module).failed == 0
