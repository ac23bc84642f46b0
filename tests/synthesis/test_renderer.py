"""The renderer is right: depth, normals, textures, light, lens, motion."""

from dataclasses import replace
from typing import Any

import cv2
import numba
import numpy as np
import pytest
from numpy.typing import NDArray

from edvo.camera import Camera
from edvo.errors import SceneError
from edvo.synthesis import kernels
from edvo.synthesis.light import ConstantLight, DirectionalLight, LightState, PointLight
from edvo.synthesis.motion import look_at
from edvo.synthesis.renderer import Renderer, Shutter
from edvo.synthesis.scene import Scene, load_scene

CAMERA = Camera(160, 120, 135.0, 134.0, 79.3, 60.4)
DISTORTED = Camera(160, 120, 135.0, 134.0, 79.3, 60.4, (0.26, -0.95, -0.005, 0.003, 1.16))
FULL = LightState(1.0)
FORWARD = look_at(np.array([0.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]))
WALL = {
    "shape": "panel",
    "material": "grey",
    "corner": [-5, 1.0, -5],
    "along": [10, 0, 0],
    "up": [0, 0, 10],
}
CHECKER = {"albedo": [1, 1, 1], "texture": {"kind": "checker", "size": [0.2, 0.2]}}


def scene(*shapes: dict[str, Any], **more: Any) -> Scene:
    materials = {
        "grey": {"albedo": [0.5, 0.5, 0.5]},
        "white": {"albedo": [1, 1, 1]},
        "checker": CHECKER,
        **more.pop("materials", {}),
    }
    return Scene.from_dict(
        {
            "materials": materials,
            "shapes": list(shapes),
            "lights": {"ambient": 1.0},
            "camera": {"points": [[0, -3, 1], [1, -3, 1]], "targets": [[0, 0, 1], [1, 0, 1]]},
            **more,
        }
    )


def rays(camera: Camera) -> NDArray[np.float64]:
    """Directions of all pixels on the plane z = 1, camera frame, (N, 3)."""
    v, u = np.mgrid[0 : camera.height, 0 : camera.width]
    raw = np.stack([u.ravel(), v.ravel()], 1).astype(float)
    ideal = (camera.undistort(raw) - [camera.cx, camera.cy]) / [camera.fx, camera.fy]
    return np.column_stack([ideal, np.ones(len(ideal))])


@pytest.mark.parametrize("camera", [CAMERA, DISTORTED], ids=["pinhole", "distorted"])
def test_depth_and_normals_of_a_slanted_plane_are_the_analytic_ones(camera: Camera) -> None:
    wall = {**WALL, "along": [10, 3, 0.5], "corner": [-5, -0.5, -5.25]}
    pose = look_at(np.array([0.1, -0.2, 0.05]), np.array([0.3, 1.0, 0.1]))
    view = Renderer(scene(wall), camera).render(pose)
    n = np.cross(wall["along"], wall["up"])
    n = n / np.linalg.norm(n)
    n = n if n[1] < 0 else -n
    direction = rays(camera) @ pose[:3, :3].T
    depth = (n @ (np.array(wall["corner"]) - pose[:3, 3])) / (direction @ n)
    assert 0.5 < depth.min() < depth.max() < 2.0
    assert np.abs(view.depth.ravel() - depth).max() < 1e-6
    expected = np.broadcast_to(pose[:3, :3].T @ n, view.normals.shape)
    np.testing.assert_allclose(view.normals, expected, atol=1e-6)


def corners(size: float, shift: float) -> NDArray[np.float64]:
    """Inner corners of the checker wall at y = 1 (texture starts at its corner -5)."""
    grid = np.arange(-0.6, 0.61, size)
    x, z = np.meshgrid(grid, grid)
    return np.stack([x.ravel(), np.full(x.size, 1.0), z.ravel() + shift], 1)


def seen_at(camera: Camera, pose: NDArray[np.float64], points: NDArray[np.float64]) -> Any:
    return camera.project((points - pose[:3, 3]) @ pose[:3, :3])


def checker_by_subsampling(camera: Camera, pose: NDArray[np.float64]) -> NDArray[np.float64]:
    """The wall at y = 1 by exact samples: an image made without the renderer."""
    total = np.zeros((camera.height, camera.width))
    v, u = np.mgrid[0 : camera.height, 0 : camera.width]
    for k in range(144):
        shift = np.array([k + 0.5, (13 * k) % 144 + 0.5]) / 144 - 0.5
        raw = np.stack([u.ravel(), v.ravel()], 1) + shift
        ideal = (camera.undistort(raw) - [camera.cx, camera.cy]) / [camera.fx, camera.fy]
        d = np.column_stack([ideal, np.ones(len(ideal))]) @ pose[:3, :3].T
        hit = pose[:3, 3] + ((1.0 - pose[1, 3]) / d[:, 1])[:, None] * d
        cells = np.floor((hit[:, 0] + 5) / 0.2) + np.floor((hit[:, 2] + 5) / 0.2)
        total += (cells % 2 == 0).reshape(total.shape)
    return total / 144


def shifts(
    image: NDArray[np.float64], reference: NDArray[np.float64], points: NDArray[np.float64]
) -> NDArray[np.float64]:
    """How far the image lies from the reference in windows of 15 pixels, by least squares."""
    gy, gx = np.gradient(cv2.GaussianBlur(reference, (0, 0), 1.0))
    difference = cv2.GaussianBlur(reference - image, (0, 0), 1.0)
    found = []
    for x, y in np.rint(points).astype(int):
        window = np.s_[y - 7 : y + 8, x - 7 : x + 8]
        J = np.stack([gx[window].ravel(), gy[window].ravel()], 1)
        found.append(np.linalg.lstsq(J, difference[window].ravel(), rcond=None)[0])
    return np.array(found)


@pytest.mark.parametrize("distorted", [False, True], ids=["pinhole", "distorted"])
def test_a_checkerboard_follows_the_analytic_homography(distorted: bool) -> None:
    lens = (0.05, -0.1, 0.001, -0.001, 0.02) if distorted else (0.0,) * 5
    # A small one: what takes long is the exact image. The bounds are those of 320 x 240, by angle.
    camera = Camera(200, 150, 167.3, 168.5, 100.1, 77.4, lens)
    renderer = Renderer(scene({**WALL, "material": "checker"}), camera)
    grid = np.arange(-0.6, 0.61, 0.2)
    board = np.array([[x, 1.0, z] for x in grid for z in grid])
    poses = [
        look_at(np.array([0.0, -0.1, 0.0]), np.array([0.02, 1, 0])),
        look_at(np.array([0.25, -0.2, 0.1]), np.array([-0.05, 1, -0.05])),
    ]
    exact = [camera.project((board - pose[:3, 3]) @ pose[:3, :3]) for pose in poses]
    both = np.all([((p > 10) & (p < [189, 139])).all(1) for p in exact], axis=0)
    assert both.sum() >= 15
    measured = []
    for pose, points in zip(poses, exact, strict=True):
        image = renderer.render(pose).colour[:, :, 0].astype(float)
        error = shifts(image, checker_by_subsampling(camera, pose), points[both])
        assert np.abs(error).max() < 0.0125
        measured.append(camera.undistort(points[both] + error))
    # The homography of a plane n . X = d in the first camera: K (R + t n^T / d) K^-1.
    T = np.linalg.inv(poses[1]) @ poses[0]
    n = poses[0][:3, :3].T @ [0.0, 1.0, 0.0]
    d = 1.0 - poses[0][1, 3]
    H = camera.matrix @ (T[:3, :3] + np.outer(T[:3, 3], n) / d) @ np.linalg.inv(camera.matrix)
    moved = cv2.perspectiveTransform(measured[0].reshape(-1, 1, 2), H).reshape(-1, 2)
    assert np.abs(moved - measured[1]).max() < 0.03


def test_an_edge_pixel_holds_the_share_that_each_side_covers() -> None:
    # The edge of a white panel before a black world, at a known fraction of a pixel.
    for share in (0.125, 0.5, 0.875):
        x = (CAMERA.width // 2 + share - 0.5 - CAMERA.cx) / CAMERA.fx
        wall = {**WALL, "corner": [-5, 1, -5], "along": [5 + x, 0, 0], "material": "white"}
        view = Renderer(scene(wall), CAMERA, samples=8).render(FORWARD)
        row = view.colour[60, :, 0]
        assert row[CAMERA.width // 2] == pytest.approx(share, abs=1e-6)
        assert (row[: CAMERA.width // 2] == 1).all()
        assert (row[CAMERA.width // 2 + 1 :] == 0).all()
        assert (view.things[60, CAMERA.width // 2 + 1 :] == -1).all()
        assert (view.depth[60, CAMERA.width // 2 + 1 :] == 0).all()


def test_texture_too_fine_for_a_pixel_is_averaged_not_aliased() -> None:
    fine = {"fine": {**CHECKER, "texture": {"kind": "checker", "size": [0.001, 0.001]}}}
    wall = {**WALL, "material": "fine"}
    view = Renderer(scene(wall, materials=fine), CAMERA).render(FORWARD)
    assert np.abs(view.colour - 0.5).max() < 0.03


@pytest.mark.parametrize(
    "texture",
    [
        {"kind": "noise", "size": [0.3, 0.2], "octaves": 4},
        {"kind": "tiles", "size": [0.1, 0.2], "octaves": 2, "hue": True},
        {"kind": "bricks", "size": [0.2, 0.1], "joint": 0.02},
        {"kind": "books", "size": [0.05, 0.3], "hue": True},
        {"kind": "wood", "size": [0.5, 0.08]},
        {"kind": "text", "size": [0.03, 0.08]},
    ],
    ids=lambda texture: texture["kind"],
)
def test_a_texture_stays_between_its_albedos_and_is_seen_alike_from_near_and_far(
    texture: dict[str, Any],
) -> None:
    materials = {"mine": {"albedo": [0.9, 0.8, 0.7], "texture": {**texture, "albedo": [0.1] * 3}}}
    centred = Camera(160, 120, 135.0, 135.0, 79.5, 59.5)  # quarters of it fall on pixels
    renderer = Renderer(scene({**WALL, "material": "mine"}, materials=materials), centred)
    near = renderer.render(look_at(np.array([0, 0.0, 0]), np.array([0, 1.0, 0]))).albedo
    far = renderer.render(look_at(np.array([0, -3.0, 0]), np.array([0, 1.0, 0]))).albedo
    for image in (near, far):
        assert image.min() >= 0.1 - 1e-6
        assert (image <= np.float32([0.9, 0.8, 0.7]) + 1e-6).all()
    assert near.std() > 0.02
    # Four times as far, the middle quarter is what was the whole view.
    shrunk = cv2.resize(near, (40, 30), interpolation=cv2.INTER_AREA)
    middle = far[45:75, 60:100]
    assert abs(float(shrunk.mean() - middle.mean())) < 0.05
    assert np.corrcoef(shrunk[..., 0].ravel(), middle[..., 0].ravel())[0, 1] > 0.6


def test_a_cylinder() -> None:
    can = {"shape": "cylinder", "material": "grey", "at": [0, 2, -5], "radius": 0.5, "height": 10}
    view = Renderer(scene(can), CAMERA).render(FORWARD)
    x = rays(CAMERA)[:, 0]
    # (t x)^2 + (t - 2)^2 = r^2
    inside = (1 + x**2) * (0.25 - 4) + 4
    depth = np.where(inside > 0, (2 - np.sqrt(np.maximum(inside, 0))) / (1 + x**2), 0)
    clear = np.abs(inside) > 1e-6
    assert np.abs(view.depth.ravel() - depth)[clear].max() < 1e-6
    n = np.stack([depth * x, np.zeros_like(x), depth - 2], 1) / 0.5
    hit = clear & (depth > 0)
    np.testing.assert_allclose(view.normals.reshape(-1, 3)[hit], n[hit], atol=1e-6)
    lying = {**can, "at": [0, 1.5, 0], "pitch": 90, "yaw": -90, "radius": 0.3, "height": 1}
    end = Renderer(scene(lying), CAMERA).render(FORWARD)  # its axis along the view: a disc
    assert end.depth[60, 79] == pytest.approx(0.5, abs=1e-6)
    np.testing.assert_allclose(end.normals[60, 79], [0, 0, -1], atol=1e-6)


def test_a_mesh_of_a_box_is_the_box() -> None:
    box = {"shape": "box", "material": "grey", "at": [0, 2, -0.5], "size": [1, 1, 1], "yaw": 33}
    v = [[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (0, 1)]
    quads = [(0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5)]
    faces = [f for a, b, c, d in quads for f in ([a, b, c], [a, c, d])]
    mesh = {**box, "shape": "mesh", "vertices": v, "faces": faces}
    del mesh["size"]
    pose = look_at(np.array([0.3, 0, 0.9]), np.array([0, 2.0, 0]))
    a, b = (Renderer(scene(s), CAMERA).render(pose) for s in (box, mesh))
    assert (a.depth > 0).any()
    np.testing.assert_allclose(a.depth, b.depth, atol=1e-6)
    np.testing.assert_allclose(a.normals, b.normals, atol=1e-6)
    np.testing.assert_allclose(a.colour, b.colour, atol=1e-6)


def crowded(count: int) -> Scene:
    random = np.random.default_rng(5)
    shapes = []
    for k in range(count):
        at = [*random.uniform(-1.5, 1.5, 2), random.uniform(-1.5, 1.5)]
        turn = {"yaw": random.uniform(0, 90), "roll": random.uniform(0, 90)}
        if k % 5 == 0:
            shapes.append(
                {"shape": "cylinder", "material": "grey", "radius": 0.05, "height": 0.2, "at": at}
                | turn
            )
        else:
            size = random.uniform(0.02, 0.2, 3).tolist()
            shapes.append({"shape": "box", "material": "grey", "size": size, "at": at} | turn)
    return scene(*shapes)


@pytest.mark.parametrize("count", [10, 60, 700])
def test_the_tree_finds_what_trying_everything_finds(count: int) -> None:
    # 700 boxes are more than a tile may list, so rays walk the tree there.
    renderer = Renderer(crowded(count), CAMERA)
    pose = look_at(np.array([0.1, -3.0, 0.2]), np.array([0.0, 0.0, 0.0]))
    view = renderer.render(pose)
    solids = renderer.world.at(0.0)
    choice = np.random.default_rng(1).choice(CAMERA.width * CAMERA.height, 300, replace=False)
    direction = rays(CAMERA)[choice] @ pose[:3, :3].T
    depth = np.full(len(choice), np.inf)
    for k, d in enumerate(direction):
        for i in range(len(solids.kind)):
            t = kernels._meet(solids.kind[i], solids.shape, i, *pose[:3, 3], *d, np.inf)
            depth[k] = t if 0 < t < depth[k] else depth[k]
    depth[np.isinf(depth)] = 0
    assert (depth > 0).sum() > 5
    np.testing.assert_allclose(view.depth.ravel()[choice], depth, atol=1e-6)


@pytest.mark.parametrize("name", ["notexture_far", "cabinet", "crowd"])
def test_the_same_bytes_for_any_number_of_threads(name: str) -> None:
    packaged = load_scene(name)
    path = packaged.camera
    pose = look_at(np.array(path.points[1]), np.array(path.targets[1]))
    views = [Renderer(packaged, DISTORTED, threads=n).render(pose, t=1.0) for n in (1, 2, 5)]
    for other in views[1:]:
        for field in ("colour", "depth", "normals", "albedo", "things"):
            assert getattr(views[0], field).tobytes() == getattr(other, field).tobytes()


def test_things_that_walk_are_where_their_path_is() -> None:
    walk = {"path": [[0, 0, 0], [0, 4, 0]], "speed": 0.5, "closed": False}
    box = {"shape": "box", "material": "grey", "at": [0, 2, -1], "size": [2, 1, 2], "walk": walk}
    renderer = Renderer(scene(box, {**WALL, "corner": [-5, 9, -5]}), CAMERA)
    # A B-spline from 0 to 4 and back runs between 4/3 and 8/3: there in 8/3 s, and back again.
    for t, way in ((0.0, 4 / 3), (1.0, 4 / 3 + 0.5), (8 / 3, 8 / 3), (16 / 3, 4 / 3)):
        view = renderer.render(FORWARD, t=t)
        assert view.depth[60, 79] == pytest.approx(2 + way - 0.5, abs=2e-3)
        assert view.things[60, 79] == 0


def test_lambert_and_the_inverse_square() -> None:
    renderer = Renderer(scene(WALL), CAMERA)
    tilted = DirectionalLight((0.0, 1.0, -1.0), 0.8)
    view = renderer.render(FORWARD, light=LightState(0.1, (tilted,)))
    np.testing.assert_allclose(view.colour, 0.5 * (0.1 + 0.8 / np.sqrt(2)), rtol=1e-6)
    behind = DirectionalLight((0.0, -1.0, 0.0), 0.8)
    view = renderer.render(FORWARD, light=LightState(0.1, (behind,)))
    np.testing.assert_allclose(view.colour, 0.05, rtol=1e-6)
    lamp = PointLight((0.0, 0.0, 0.0), 2.0)
    view = renderer.render(FORWARD, light=LightState(0.0, (), (lamp,)))
    cosine = 1 / np.linalg.norm(rays(CAMERA), axis=1)
    np.testing.assert_allclose(
        view.colour[..., 0].ravel(), 0.5 * 2.0 * cosine * cosine**2, rtol=1e-5
    )


def test_gloss_and_glow() -> None:
    materials = {
        "shiny": {"albedo": [0.2] * 3, "gloss": 0.5, "shininess": 50},
        "lamp": {"albedo": [0.5] * 3, "glow": 2.0},
    }
    light = LightState(0.0, (DirectionalLight((0.0, 1.0, 0.0), 1.0),))
    shiny = Renderer(scene({**WALL, "material": "shiny"}, materials=materials), CAMERA)
    view = shiny.render(FORWARD, light=light)
    assert view.colour[60, 79, 0] == pytest.approx(0.7, abs=1e-3)  # the mirror direction
    assert view.colour[0, 0, 0] < 0.4
    lamp = Renderer(scene({**WALL, "material": "lamp"}, materials=materials), CAMERA)
    np.testing.assert_allclose(lamp.render(FORWARD, light=LightState(0.0)).colour, 1.0)


@pytest.mark.parametrize("kind", ["directional", "point"])
def test_shadows_hard_and_soft(kind: str) -> None:
    floor = {**WALL, "corner": [-5, -5, -1], "along": [10, 0, 0], "up": [0, 10, 0]}
    roof = {**floor, "corner": [-5, -5, 1], "along": [5, 0, 0], "material": "white"}
    renderer = Renderer(scene(floor, roof), CAMERA, samples=1)
    pose = look_at(np.array([0.0, -2.0, 0.0]), np.array([0.0, 0.0, -1.0]))
    for size in (0.0, 0.2):
        light = (
            LightState(0.0, (DirectionalLight((0, 0, -1), 1.0, size, True),))
            if kind == "directional"
            else LightState(0.0, (), (PointLight((0, 0, 50), 51.0**2, 10 * size, True),))
        )
        view = renderer.render(pose, light=light)
        row = view.colour[90, :, 0]
        x = rays(CAMERA)[90 * CAMERA.width :][: CAMERA.width, 0] * view.depth[90]
        assert (row[x < -0.6] == 0).all()
        assert (row[x > 0.6] > 0.45).all()
        between = (row > 0.02) & (row < 0.45)
        assert between.any() == (size > 0)
        if size:
            assert np.abs(x[between]).max() < 0.55
            assert row[np.argmin(np.abs(x))] == pytest.approx(0.25, abs=0.06)


@pytest.mark.parametrize("count", [200, 700])
@pytest.mark.parametrize("kind", ["directional", "point"])
def test_shadows_are_those_of_trying_everything(kind: str, count: int) -> None:
    renderer = Renderer(crowded(count), CAMERA, samples=1)
    pose = look_at(np.array([0.1, -3.0, 0.2]), np.array([0.0, 0.0, 0.0]))
    lamp: Any = (
        DirectionalLight((0.3, 0.8, -0.6), 1.0, 0.0, True)
        if kind == "directional"
        else PointLight((0.8, -2.5, 1.5), 5.0, 0.0, True)
    )
    lamps: Any = [(replace(lamp, shadows=shadows),) for shadows in (True, False)]
    light, free = (replace(LightState(0.0), **{kind: x}) for x in lamps)
    shaded = renderer.render(pose, light=light).colour[..., 0].ravel()
    open_ = renderer.render(pose, light=free)
    lit = np.flatnonzero((open_.colour[..., 0] > 1e-3).ravel())
    choice = np.random.default_rng(1).choice(lit, 200, replace=False)
    points = rays(CAMERA)[choice] * open_.depth.ravel()[choice, None].astype(float)
    solids, seen = renderer.world.at(0.0), []
    for p in points @ pose[:3, :3].T + pose[:3, 3]:
        way = -np.array(lamp.direction) if kind == "directional" else np.array(lamp.position) - p
        far = np.inf if kind == "directional" else 1.0
        start = p + 1e-5 * way / np.linalg.norm(way)
        hits = (
            kernels._meet(solids.kind[i], solids.shape, i, *start, *way, far)
            for i in range(len(solids.kind))
        )
        seen.append(not any(t > 0 for t in hits))
    agree = (shaded[choice] > 0) == np.array(seen)
    assert 3 < np.sum(seen) < 197
    assert agree.mean() > 0.99  # a float32 depth puts a point or two across an edge


def test_a_convex_thing_does_not_shade_its_lit_side() -> None:
    ball = {"shape": "cylinder", "material": "white", "at": [0, 2, -1], "radius": 0.6, "height": 2}
    light = LightState(0.0, (DirectionalLight((0.0, 1.0, 0.0), 1.0, 0.0, True),))
    view = Renderer(scene(ball), CAMERA, samples=1).render(FORWARD, light=light)
    facing = -view.normals[..., 2]
    hit = view.depth > 0
    np.testing.assert_allclose(view.colour[hit][:, 0], facing[hit], atol=1e-5)


def test_rolling_shutter_takes_each_row_at_its_time() -> None:
    renderer = Renderer(scene({**WALL, "material": "checker"}), CAMERA)

    def motion(t: float) -> NDArray[np.float64]:
        return look_at(np.array([0.5 * t, 0.0, 0.0]), np.array([0.5 * t, 1.0, 0.0]))

    view = renderer.expose(motion, 0.3, shutter=Shutter(readout=0.02))
    for row in (0, 31, 60, 119):
        t = 0.3 + 0.02 * ((row + 0.5) / CAMERA.height - 0.5)
        still = renderer.render(motion(t))
        assert (view.depth[row] == still.depth[row]).all()
        # The texture has no samples of its own here: its edges are no edges of the shape.
        np.testing.assert_allclose(view.colour[row], still.colour[row], atol=1e-6)


def test_motion_blur_is_the_mean_over_the_exposure() -> None:
    renderer = Renderer(scene({**WALL, "material": "checker"}), CAMERA)

    def motion(t: float) -> NDArray[np.float64]:
        return look_at(np.array([t, 0.0, 0.0]), np.array([t, 1.0, 0.0]))

    shutter = Shutter(exposure=0.04, steps=4)
    view = renderer.expose(motion, 1.0, light=ConstantLight(FULL), shutter=shutter)
    times = 1.0 + 0.04 * ((np.arange(4) + 0.5) / 4 - 0.5)
    mean = np.mean([renderer.render(motion(t), light=FULL).colour for t in times], axis=0)
    np.testing.assert_allclose(view.colour, mean, atol=1e-6)
    still = renderer.render(motion(1.0))
    assert (view.depth == still.depth).all()
    assert (view.albedo == still.albedo).all()


def test_unlit_rendering_has_the_same_depth() -> None:
    packaged = load_scene("notexture_far")
    renderer = Renderer(packaged, CAMERA)
    path = packaged.camera
    pose = look_at(np.array(path.points[0]), np.array(path.targets[0]))
    lit, unlit = renderer.render(pose), renderer.render(pose, lit=False)
    assert (lit.depth == unlit.depth).all()
    assert (lit.normals == unlit.normals).all()
    assert not unlit.albedo.any()


def test_impossible_settings() -> None:
    with pytest.raises(SceneError, match="samples"):
        Renderer(scene(WALL), CAMERA, samples=0)
    with pytest.raises(SceneError, match="threads"):
        Renderer(scene(WALL), CAMERA, threads=0)
    with pytest.raises(SceneError, match="shutter"):
        Shutter(exposure=-1.0)
    renderer = Renderer(scene(WALL), CAMERA)
    nowhere = LightState(1.0, (DirectionalLight((0, 0, 0), 1.0),))
    with pytest.raises(SceneError, match="direction"):
        renderer.render(FORWARD, light=nowhere)


def test_kernels_compile_without_a_folder_for_the_cache(monkeypatch: pytest.MonkeyPatch) -> None:
    real = numba.njit

    def nowhere(*args: Any, **options: Any) -> Any:
        if options.get("cache"):
            raise RuntimeError("cannot cache function: no locator available")
        return real(*args, **options)

    monkeypatch.setattr(numba, "njit", nowhere)
    assert kernels.compiled(lambda x: x + 1)(2) == 3
