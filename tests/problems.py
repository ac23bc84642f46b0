"""Synthetic problems with exact answers: edges of 3-D segments, and rendered sequences."""

from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np

from edvo import kernels, se3
from edvo.camera import Camera
from edvo.config import Config
from edvo.edges import EdgePixels
from edvo.frame import Frame
from edvo.report.warmup import warm_up
from edvo.synthesis.sequence import SyntheticSource, make_recipe

# Depth in fifths of a millimetre, as in TUM files
CAMERA = Camera(320, 240, fx=262.5, fy=262.5, cx=159.5, cy=119.5, depth_scale=5000.0)
VGA = Camera(640, 480, fx=525.0, fy=525.0, cx=319.5, cy=239.5, depth_scale=5000.0)
# A Kinect v1's, whose lens bends the corners by tens of pixels.
LENS = Camera(
    width=640,
    height=480,
    fx=517.3,
    fy=516.5,
    cx=318.6,
    cy=255.3,
    distortion=(0.26, -0.95, -0.0054, 0.0026, 1.16),
    depth_scale=5000.0,
)


def error(T_true, T):
    """Distance (m) and angle (deg) between two poses."""
    E = se3.inverse(T_true) @ T
    return float(np.linalg.norm(E[:3, 3])), float(np.degrees(se3.rotation_angle(E)))


def motion(rng, translation=0.03, rotation_deg=2.0):
    """A random motion of exactly this length and angle."""
    v, w = rng.normal(size=3), rng.normal(size=3)
    v *= translation / np.linalg.norm(v)
    w *= np.radians(rotation_deg) / np.linalg.norm(w)
    return se3.exp(np.concatenate((v, w)))


def random_edges(rng, n, width=640, height=480):
    """Edges at random places in random directions."""
    angle = rng.uniform(0, 2 * np.pi, n)
    return EdgePixels(
        rng.uniform((0, 0), (width, height), (n, 2)).astype(np.float32),
        np.column_stack((np.cos(angle), np.sin(angle))).astype(np.float32),
        np.zeros(n, np.float32),
    )


def drawn_image(rng, shape=(480, 640), polygons=12):
    """Grey polygons on grey, a little blurred as a lens does."""
    height, width = shape
    image = np.full(shape, 100, np.uint8)
    for _ in range(polygons):
        centre = rng.uniform((0, 0), (width, height))
        corners = centre + rng.uniform(-0.25, 0.25, (rng.integers(3, 7), 2)) * width
        cv2.fillPoly(image, [corners.astype(np.int32)], int(rng.integers(20, 235)), cv2.LINE_AA)
    return cv2.GaussianBlur(image, (0, 0), 0.8)


@dataclass
class Problem:
    """Edges of a reference, samples of a current image, and the motion between them."""

    camera: Camera
    reference: EdgePixels
    samples: EdgePixels
    T_ref_cur: np.ndarray


def _normals(starts, ends):
    """Unit normals of segments in an image, on the same side whatever the view."""
    along = ends - starts
    normals = np.column_stack((-along[:, 1], along[:, 0]))
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


def _project(camera, points):
    u = camera.fx * points[:, 0] / points[:, 2] + camera.cx
    v = camera.fy * points[:, 1] / points[:, 2] + camera.cy
    return np.column_stack((u, v))


def segments_problem(seed, T_ref_cur, *, count=450, segments=30, outliers=0.0, camera=VGA):
    """Random segments in space: dense edges in the reference, samples as the current sees them.

    At the true motion each sample lies on the line of its reference edge to float32.
    ``outliers`` is the share of samples that are moved elsewhere in the image.
    """
    rng = np.random.default_rng(seed)
    centre = np.column_stack(
        (
            rng.uniform(60, camera.width - 60, segments),
            rng.uniform(60, camera.height - 60, segments),
        )
    )
    z = rng.uniform(1.0, 4.0, segments)
    middle = np.column_stack(
        (
            (centre[:, 0] - camera.cx) / camera.fx * z,
            (centre[:, 1] - camera.cy) / camera.fy * z,
            z,
        )
    )
    direction = rng.normal(size=(segments, 3)) * (1, 1, 0.6)
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    half = direction * (rng.uniform(0.06, 0.12, segments) * z)[:, None]

    pixels, gradients = [], []
    for m, h in zip(middle, half, strict=True):
        ends = _project(camera, np.array([m - h, m + h]))
        steps = int(np.linalg.norm(ends[1] - ends[0]) * 2) + 2
        share = np.linspace(-1, 1, steps)[:, None]
        pixels.append(_project(camera, m + share * h))
        gradients.append(np.repeat(_normals(ends[:1], ends[1:]), steps, axis=0))
    pixels, gradients = np.concatenate(pixels), np.concatenate(gradients)
    reference = EdgePixels(
        pixels.astype(np.float32), gradients.astype(np.float32), np.zeros(len(pixels), np.float32)
    )

    which = rng.integers(segments, size=count)
    share = rng.uniform(-0.85, 0.85, (count, 1))
    T_cur_ref = se3.inverse(T_ref_cur)

    def moved(points):
        return points @ T_cur_ref[:3, :3].T + T_cur_ref[:3, 3]

    points = moved(middle[which] + share * half[which])
    starts = _project(camera, moved(middle - half))
    ends = _project(camera, moved(middle + half))
    pixels = _project(camera, points)
    wrong = rng.random(count) < outliers
    pixels[wrong] += rng.uniform(-25, 25, (int(wrong.sum()), 2))
    samples = EdgePixels(
        pixels.astype(np.float32),
        _normals(starts, ends)[which].astype(np.float32),
        points[:, 2].astype(np.float32),
    )
    return Problem(camera, reference, samples, T_ref_cur)


# ------------------------------------------------------------------------------ rendered frames

TEXTURE_PX_PER_M = 150
# planes of a room corner: a point of each, its two axes (m), and its extent along them (m)
PLANES = (
    ((-2.0, -1.6, 2.6), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (4.0, 2.6)),  # wall ahead
    ((-2.0, 1.0, 0.2), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0), (4.0, 2.4)),  # floor
    ((1.4, -1.6, 0.2), (0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (2.4, 2.6)),  # wall to the right
    ((-0.5, -0.2, 1.9), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.6, 0.5)),  # a board before the wall
)


@cache
def _textures():
    rng = np.random.default_rng(5)
    textures = []
    for *_, (a, b) in PLANES:
        shape = (int(b * TEXTURE_PX_PER_M), int(a * TEXTURE_PX_PER_M))
        polygons = max(4, int(a * b * 4))
        image = np.full(shape, rng.integers(80, 170), np.uint8)
        for _ in range(polygons):
            centre = rng.uniform((0, 0), shape[::-1])
            corners = centre + rng.uniform(-0.3, 0.3, (rng.integers(3, 6), 2)) * TEXTURE_PX_PER_M
            cv2.fillPoly(image, [corners.astype(np.int32)], int(rng.integers(20, 235)), cv2.LINE_AA)
        textures.append(cv2.GaussianBlur(image, (5, 5), 1.2))
    return textures


@cache
def _shaded():
    """The same in another light, whose shadows make edges of their own."""
    rng, textures = np.random.default_rng(9), []
    for texture in _textures():
        light = np.full(texture.shape, 255, np.uint8)
        for _ in range(max(2, texture.size // 12000)):
            centre = rng.uniform((0, 0), texture.shape[::-1])
            corners = centre + rng.uniform(-0.4, 0.4, (3, 2)) * TEXTURE_PX_PER_M
            cv2.fillPoly(light, [corners.astype(np.int32)], 110, cv2.LINE_AA)
        light = cv2.GaussianBlur(light, (5, 5), 1.2)
        textures.append((texture.astype(np.uint16) * light // 255).astype(np.uint8))
    return textures


def render(T_world_cam, timestamp=0.0, camera=CAMERA, *, shaded=False):
    """The room corner as the camera sees it, its depth exact.

    All sums are element-wise and the textures are looked up in fixed point, so that every
    machine renders the same bytes.
    """
    R, origin = T_world_cam[:3, :3], T_world_cam[:3, 3]
    x = (np.arange(camera.width) - camera.cx) / camera.fx
    y = ((np.arange(camera.height) - camera.cy) / camera.fy)[:, None]
    grey = np.zeros((camera.height, camera.width), np.uint8)
    depth = np.full(grey.shape, np.inf)
    for (point, a, b, extent), texture in zip(
        PLANES, _shaded() if shaded else _textures(), strict=True
    ):
        to_plane, axes = [], np.array([np.cross(a, b), a, b])
        in_camera = [[sum(float(n[i] * R[i, k]) for i in range(3)) for k in range(3)] for n in axes]
        for n in axes:
            to_plane.append(sum(float(n[i] * (point[i] - origin[i])) for i in range(3)))
        with np.errstate(divide="ignore", invalid="ignore"):
            z = to_plane[0] / _dot(in_camera[0], x, y)
            s = z * _dot(in_camera[1], x, y) - to_plane[1]
            t = z * _dot(in_camera[2], x, y) - to_plane[2]
        here = (z > 0.05) & (z < depth)
        here &= (s >= 0) & (s <= extent[0]) & (t >= 0) & (t <= extent[1])
        column = np.where(here, s * TEXTURE_PX_PER_M - 0.5, 0).astype(np.float32)
        row = np.where(here, t * TEXTURE_PX_PER_M - 0.5, 0).astype(np.float32)
        value = cv2.remap(texture, column, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        grey[here], depth[here] = value[here], z[here]
    return Frame(timestamp, grey, np.where(np.isfinite(depth), depth, 0).astype(np.float32))


def _dot(n, x, y):
    return n[0] * x + (n[1] * y + n[2])


def path(count):
    """Poses of a slow sway, about 0.2 m/s and 8 deg/s; the first is the origin."""
    poses = []
    for k in range(count):
        t = k / 30
        sway = np.array(
            [
                0.15 * np.sin(1.3 * t),
                0.08 * np.sin(1.7 * t),
                0.12 * (1 - np.cos(1.1 * t)),
                0.05 * np.sin(1.5 * t),
                0.10 * np.sin(1.2 * t),
                0.06 * np.sin(1.9 * t),
            ]
        )
        poses.append(se3.exp(sway))
    return np.array(poses)


@cache
def sequence(count=30):
    """Frames at 30 Hz and their true poses; shared, so not to be changed."""
    poses = path(count)
    frames = tuple(render(T, 10.0 + k / 30) for k, T in enumerate(poses))
    for frame in frames:
        frame.grey.flags.writeable = frame.depth.flags.writeable = False
    return frames, poses


class Remembered(SyntheticSource):
    """A source that renders each frame once, however often it is read."""

    def __init__(self, recipe):
        super().__init__(recipe)
        self._readings = {}

    def read(self, index):
        if index not in self._readings:
            self._readings[index] = super().read(index)
        return self._readings[index]


def rendered(scene, count, **how):
    """Camera and frames of a scene, and where each is in the camera of the first one."""
    source = SyntheticSource(make_recipe(scene, frames=count, **how))
    frames = [source.read(i).frame for i in range(count)]
    truth = [source.ground_truth.at(frame.timestamp) for frame in frames]
    return source.camera, frames, [se3.inverse(truth[0]) @ T_world for T_world in truth]


def watched_by_warm_up(monkeypatch, *names):
    """By the names of kernels, whether each image that they are given may be written to.

    They are warmed up first. Images that may be written to, and those of frames, which may not, are
    of two types to numba, and a kernel is compiled for each that it is given.
    """
    writeable = {name: [] for name in names}

    def watch(name, kernel):
        def spy(grey, *others):
            writeable[name].append(grey.flags.writeable)
            return kernel(grey, *others)

        monkeypatch.setattr(kernels, name, spy)

    for name in names:
        watch(name, getattr(kernels, name))
    warm_up(Config())
    assert all(writeable.values())  # each is called
    return writeable


def ways_forgotten(odometry, monkeypatch):
    """Frames, listed as they come, by which it is noted that where it is tells no motion."""
    forget, when = odometry._progress.forget_way, []

    def noted():
        when.append(odometry._record.count)
        forget()

    monkeypatch.setattr(odometry._progress, "forget_way", noted)
    return when
