"""The point-to-plane term: planes against analytic ones, distances against plain NumPy."""

import numpy as np
import pytest

from edvo import kernels, se3
from edvo.camera import Camera
from edvo.config import Config, MatchingConfig, PlanesConfig, RegistrationConfig
from edvo.edges import NO_TABLE
from edvo.odometry import Odometry, Status
from edvo.planes import PlaneFitter, PlaneMap, PlanePoints
from edvo.registration import AT_ONCE, NOTHING_NEAR, Registration
from edvo.synthesis.sequence import SyntheticSource, make_recipe

from . import problems, twins

CAMERA = Camera(width=320, height=240, fx=260.0, fy=255.0, cx=158.3, cy=121.9)
BENT = Camera(
    width=320,
    height=240,
    fx=260.0,
    fy=255.0,
    cx=158.3,
    cy=121.9,
    distortion=(0.1, -0.2, 1e-3, -2e-3, 0.05),
)
PLANE = np.array([0.3, -0.2, 0.93])
FIXED = "planes.edge_doubt_rule=fixed"


def depth_of(camera, normal, offset):
    """Depth image of the plane normal . X = offset."""
    v, u = np.mgrid[: camera.height, : camera.width]
    raw = np.stack([u.ravel(), v.ravel()], 1).astype(np.float64)
    rays = camera.backproject(raw, np.ones(len(raw)))
    return (offset / (rays @ normal)).reshape(camera.height, camera.width).astype(np.float32)


def unit(vector):
    return np.asarray(vector) / np.linalg.norm(vector)


@pytest.mark.parametrize("camera", [CAMERA, BENT], ids=["ideal", "distorted"])
def test_an_exact_plane_is_found(camera):
    normal, offset = unit(PLANE), 1.8
    points = PlaneFitter(camera, PlanesConfig()).points(depth_of(camera, normal, offset))
    assert len(points.sigma) > 200
    np.testing.assert_allclose(points.X @ normal, offset, atol=2e-6)
    np.testing.assert_allclose(points.normals @ normal, 1, atol=1e-7)


@pytest.mark.parametrize("camera", [CAMERA, BENT], ids=["ideal", "distorted"])
def test_points_of_a_frame_lie_on_the_planes_of_the_same_frame(camera):
    depth = depth_of(camera, unit(PLANE), 1.8)
    fitter = PlaneFitter(camera, PlanesConfig())
    planes, points = fitter.planes(depth), fitter.points(depth)
    found = kernels.new_plane_matches(len(points.sigma))
    pinhole = kernels.Pinhole(camera.fx, camera.fy, camera.cx, camera.cy, 320, 240)
    count = kernels.match_planes(planes, points, pinhole, np.eye(4), fitter.term, found)
    assert count > 0.9 * len(points.sigma)
    np.testing.assert_allclose(found.residuals[:count], 0, atol=2e-3)  # of the noise


def test_noise_averages_out_in_the_window():
    rng = np.random.default_rng(0)
    normal, offset = unit(PLANE), 1.8
    fitter = PlaneFitter(CAMERA, PlanesConfig())
    depth = depth_of(CAMERA, normal, offset)
    sigma = fitter._noise.sigma_z(depth)
    points = fitter.points((depth + sigma * rng.standard_normal(depth.shape)).astype(np.float32))
    off = (points.X @ normal - offset) / points.sigma
    assert 0.1 < np.std(off) < 0.35  # of 25 pixels: a fifth
    assert abs(np.mean(off)) < 0.05


def test_there_is_no_plane_across_a_step_or_a_hole():
    depth = np.full((240, 320), 2.0, np.float32)
    depth[:, 160:] = 1.0
    depth[100:140, 40:80] = 0
    points = PlaneFitter(CAMERA, PlanesConfig()).points(depth)
    u, v = CAMERA.project(points.X).T
    assert len(points.sigma) > 100
    assert not (np.abs(u - 159.5) < 7.5).any()
    assert not ((u > 38) & (u < 81) & (v > 98) & (v < 141)).any()


def test_a_frame_without_depth_has_no_points():
    fitter = PlaneFitter(CAMERA, PlanesConfig())
    assert len(fitter.points(np.zeros((240, 320), np.float32)).sigma) == 0
    assert not fitter.planes(np.zeros((240, 320), np.float32)).offsets.any()


def depth_with_holes_and_steps(rng):
    """Slanted patches of several depths, rough here and there, with holes."""
    v, u = np.mgrid[:240, :320]
    depth = np.zeros((240, 320))
    for patch in range(12):
        top, left = rng.integers(0, 200), rng.integers(0, 260)
        w = rng.uniform(0.3, 1.2) + rng.normal(0, 4e-4) * u + rng.normal(0, 4e-4) * v
        noise = 1 + 10 ** rng.uniform(-4, -1.5) * rng.standard_normal(w.shape)
        inside = (v >= top) & (v < top + 130) & (u >= left) & (u < left + 150)
        if patch == 0:
            inside[:] = True
        depth = np.where(inside, noise / np.maximum(w, 0.1), depth)
    return np.where(rng.random(depth.shape) < rng.choice([0.02, 0.2]), 0, depth).astype(np.float32)


def planes_by_numpy(depth, nodes, sigma, table, camera, config):
    """What fit_planes computes: normals, offsets and centres, and how sure the choices are."""
    height, width = depth.shape
    normals, offsets = np.zeros((len(nodes), 3)), np.zeros(len(nodes))
    centres, sure = np.zeros((len(nodes), 3)), np.ones(len(nodes), bool)
    reach = np.arange(-config.reach_px, config.reach_px + 1, config.stride_px)
    for k, (u0, v0) in enumerate(nodes):
        if not (0 <= u0 < width and 0 <= v0 < height) or depth[v0, u0] == 0:
            continue
        v, u = (part.ravel() for part in np.meshgrid(v0 + reach, u0 + reach, indexing="ij"))
        inside = (u >= 0) & (u < width) & (v >= 0) & (v < height)
        u, v = u[inside], v[inside]
        u, v = u[depth[v, u] > 0], v[depth[v, u] > 0]
        if len(u) < 0.75 * len(reach) ** 2:
            continue
        pixel = np.column_stack([u, v]).astype(float)
        node = np.array([u0, v0], float)
        if table is not None:
            pixel, node = table[v, u].astype(float), table[v0, u0].astype(float)
        A = np.column_stack([pixel - node, np.ones(len(u))])
        inverse = 1 / depth[v, u].astype(float)
        (a, b, w), *_ = np.linalg.lstsq(A, inverse, rcond=None)
        off = np.sqrt(np.mean((inverse - A @ [a, b, w]) ** 2))
        bound = config.flatness * sigma[k] / float(depth[v0, u0]) ** 2
        sure[k] = abs(off / bound - 1) > 1e-4
        if off > bound or w <= 0:
            continue
        # 1 / z is N . X / z, and X / z the ray of a pixel: N by three rays
        rays = node + np.array([[0, 0], [1, 0], [0, 1]]) - [camera.cx, camera.cy]
        rays = np.column_stack([rays / [camera.fx, camera.fy], np.ones(3)])
        N = np.linalg.solve(rays, [w, w + a, w + b])
        normals[k], offsets[k] = N / np.linalg.norm(N), 1 / np.linalg.norm(N)
        centres[k] = rays[0] / w
    return normals, offsets, centres, sure


@pytest.mark.parametrize("camera", [CAMERA, BENT], ids=["ideal", "distorted"])
@pytest.mark.parametrize("seed", range(3))
def test_fitting_equals_its_numpy_twin(camera, seed):
    rng = np.random.default_rng(seed)
    depth = depth_with_holes_and_steps(rng)
    config = PlanesConfig()
    table = camera.undistortion_table() if camera.is_distorted else None
    nodes = rng.integers([-3, -3], [323, 243], (600, 2)).astype(np.int32)  # some are outside
    sigma = rng.uniform(2e-3, 2e-2, len(nodes))
    pinhole = kernels.Pinhole(camera.fx, camera.fy, camera.cx, camera.cy, 320, 240)
    normals, offsets, centres = np.zeros((600, 3)), np.zeros(600), np.zeros((600, 3))
    kernels.fit_planes(
        depth,
        nodes,
        sigma,
        NO_TABLE if table is None else table,
        pinhole,
        config.reach_px,
        config.stride_px,
        config.flatness,
        normals,
        offsets,
        centres,
    )
    wanted = planes_by_numpy(depth, nodes, sigma, table, camera, config)
    sure = wanted[3]
    assert sure.mean() > 0.99
    assert ((offsets > 0) == (wanted[1] > 0))[sure].all()
    found = sure & (offsets > 0)
    assert 30 < found.sum() < 570
    for mine, numpy in zip((normals, offsets, centres), wanted, strict=False):
        np.testing.assert_allclose(mine[found], numpy[found], rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize(
    ("reach", "stride", "first", "step"),
    [
        (8, 2, 0, 8),
        (8, 2, 8, 16),
        (8, 4, 4, 12),
        (8, 1, 0, 64),
        (8, 3, 0, 9),  # of these the middle is none of the pixels that are looked at
        (7, 4, 0, 8),
        (3, 4, 2, 4),
    ],
)
@pytest.mark.parametrize("seed", range(3))
def test_fitting_row_by_row_equals_fitting_node_by_node(reach, stride, first, step, seed):
    depth = depth_with_holes_and_steps(np.random.default_rng(seed))
    v, u = (part.ravel() for part in np.mgrid[first:240:step, first:320:step])
    nodes = np.column_stack([u, v]).astype(np.int32)
    n = len(nodes)
    sigma = np.random.default_rng(seed).uniform(2e-3, 2e-2, n)
    pinhole = kernels.Pinhole(CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy, 320, 240)
    rule = reach, stride, PlanesConfig().flatness
    by_node, by_row = ((np.zeros((n, 3)), np.zeros(n), np.zeros((n, 3))) for _ in range(2))
    kernels.fit_planes_by_row(depth, first, step, sigma, pinhole, *rule, *by_row)
    kernels.fit_planes(depth, nodes, sigma, NO_TABLE, pinhole, *rule, *by_node)
    assert 0 < (by_node[1] > 0).sum() < n
    np.testing.assert_array_equal(by_row[1] > 0, by_node[1] > 0)
    for mine, other in zip(by_row, by_node, strict=True):
        np.testing.assert_allclose(mine, other, rtol=1e-9, atol=1e-10)


def random_scene(rng):
    """Planes of random directions on a grid, and points that lie about them."""
    rows, cols, step = 8, 10, 32.0
    normals = rng.normal([0, 0, 3], 0.3, (rows * cols, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    offsets = rng.uniform(1.5, 1.6, rows * cols)
    offsets[rng.random(rows * cols) < 0.2] = 0
    planes = PlaneMap(normals, offsets, rows, cols, step)
    pixels = rng.uniform([-20, -20], [340, 260], (300, 2))
    X = CAMERA.backproject(pixels, rng.uniform(1.4, 1.7, 300))
    n = rng.normal([0, 0, 3], 0.3, (300, 3))
    points = PlanePoints(
        X, n / np.linalg.norm(n, axis=1)[:, None], rng.uniform(2e-3, 8e-3, 300), 16.0
    )
    return planes, points


@pytest.mark.parametrize("seed", range(5))
def test_matching_equals_its_numpy_twin(seed):
    rng = np.random.default_rng(seed)
    planes, points = random_scene(rng)
    T = se3.exp(rng.normal(0, 0.05, 6))
    term = PlaneFitter(CAMERA, PlanesConfig()).term
    pinhole = kernels.Pinhole(CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy, 320, 240)
    found = kernels.new_plane_matches(300)
    count = kernels.match_planes(planes, points, pinhole, T, term, found)
    normal, Y, r = twins.match_planes(planes, points, CAMERA, T, term)
    assert count == len(r) > 50
    np.testing.assert_allclose(found.residuals[:count], r, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(found.normal[:, :count].T, normal, rtol=1e-9)
    np.testing.assert_allclose(found.Y[:, :count].T, Y, rtol=1e-12)


def test_what_a_grazing_view_counts_and_that_nothing_is_seen_behind():
    rng = np.random.default_rng(0)
    normal = np.array([np.cos(0.03), 0.0, np.sin(0.03)])  # 1.7 degrees from the middle ray
    planes = PlaneMap(np.tile(normal, (80, 1)), np.full(80, 0.05), 8, 10, 32.0)
    pixels = np.column_stack((CAMERA.cx + rng.uniform(0, 8, 60), rng.uniform(40, 200, 60)))
    X = CAMERA.backproject(pixels, np.ones(60))
    X *= (0.05 / (X @ normal))[:, None] * rng.uniform(0.99, 1.01, (60, 1))
    X[::6] *= -1
    X[1::6] *= 0.04 / X[1::6, 2:]
    X[2::6, 2] = 0
    points = PlanePoints(X, np.tile(normal, (60, 1)), rng.uniform(2e-3, 8e-3, 60), 16.0)
    term = PlaneFitter(CAMERA, PlanesConfig(max_distance=50.0)).term
    pinhole = kernels.Pinhole(CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy, 320, 240)
    found = kernels.new_plane_matches(60)
    count = kernels.match_planes(planes, points, pinhole, np.eye(4), term, found)
    with np.errstate(divide="ignore"):
        _, Y, r = twins.match_planes(planes, points, CAMERA, np.eye(4), term)
    assert count == len(r) == 30
    np.testing.assert_allclose(found.residuals[:count], r, rtol=1e-9, atol=1e-9)
    assert (Y @ normal / Y[:, 2]).min() < 0.05  # where the bound on the cosine tells


@pytest.mark.parametrize("stride", [1, 2, 3])
@pytest.mark.parametrize("m", [0, 1, kernels.LANES, kernels.LANES + 1, 3 * kernels.LANES])
def test_every_so_manyth_point_is_matched(m, stride):
    rng = np.random.default_rng(m)
    planes, points = random_scene(rng)
    few = points._replace(X=points.X[:m], normals=points.normals[:m], sigma=points.sigma[:m])
    term = PlaneFitter(CAMERA, PlanesConfig()).term
    pinhole = kernels.Pinhole(CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy, 320, 240)
    T, every = se3.exp(rng.normal(0, 0.05, 6)), kernels.new_plane_matches(len(points.sigma))
    among = kernels.match_planes(planes, points, pinhole, T, term, every)
    found = kernels.new_plane_matches(len(few.sigma))
    count = kernels.match_planes(planes, few, pinhole, T, term, found, np.int64(stride))
    wanted = [k for k in range(among) if every.point[k] < m and every.point[k] % stride == 0]
    np.testing.assert_array_equal(found.point[:count], every.point[wanted])
    np.testing.assert_array_equal(found.Y[:, :count], every.Y[:, wanted])
    np.testing.assert_array_equal(found.normal[:, :count], every.normal[:, wanted])
    np.testing.assert_array_equal(found.residuals[:count], every.residuals[wanted])


@pytest.mark.parametrize("seed", range(5))
def test_points_that_are_carried_keep_their_planes(seed):
    rng = np.random.default_rng(seed)
    planes, points = random_scene(rng)
    T, step = se3.exp(rng.normal(0, 0.05, 6)), se3.exp(rng.normal(0, 1e-4, 6))
    term = PlaneFitter(CAMERA, PlanesConfig()).term
    pinhole = kernels.Pinhole(CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy, 320, 240)
    found, carried = kernels.new_plane_matches(300), kernels.new_plane_matches(300)
    count = kernels.match_planes(planes, points, pinhole, T, term, found)
    kernels.carry_points(found, count, step, carried)
    Y = found.Y[:, :count].T @ step[:3, :3].T + step[:3, 3]
    np.testing.assert_allclose(carried.Y[:, :count].T, Y, rtol=1e-12)
    np.testing.assert_array_equal(carried.normal[:, :count], found.normal[:, :count])
    np.testing.assert_array_equal(carried.point[:count], found.point[:count])
    # those that project onto the same plane are as far off it as if they were matched anew
    k, again = found.point[:count], kernels.new_plane_matches(300)
    kept = kernels.match_planes(planes, points, pinhole, step @ T, term, again)
    _, one, other = np.intersect1d(k, again.point[:kept], return_indices=True)
    same = np.abs(again.normal[:, other] / found.normal[:, one] - 1).max(axis=0) < 0.01
    assert same.sum() > 0.8 * count
    r, moved = carried.residuals[:count][one][same], found.residuals[:count][one][same]
    np.testing.assert_allclose(r, again.residuals[:kept][other][same], rtol=0.01, atol=0.01)
    assert np.abs(r - moved).max() > 0.02  # by more than that they have moved


@pytest.mark.parametrize("share", [0.0, -0.4])
@pytest.mark.parametrize("seed", range(3))
def test_before_one_wall_points_that_keep_their_planes_end_where_others_do(seed, share):
    """All of the map is one plane, so that no point could have another."""
    rng = np.random.default_rng(seed)
    T = problems.motion(rng, 0.08, 4.0)
    problem = problems.segments_problem(seed, T, outliers=0.1)
    normal, offset, rows, cols = unit([0.2, -0.3, 1.0]), 2.0, 60, 80
    planes = PlaneMap(
        np.tile(normal, (rows * cols, 1)), np.full(rows * cols, offset), rows, cols, 8.0
    )
    T_last = T @ se3.exp(rng.normal(0, 0.01, 6))
    lag = AT_ONCE._replace(share=share, T_ref_last=T_last)
    T_cur_ref = se3.inverse(kernels.lagged(T, lag))
    pixels = rng.uniform([150, 150], [490, 330], (400, 2))
    rays = problem.camera.backproject(pixels, np.ones(400))
    X = rays * (offset / (rays @ normal))[:, None] @ T_cur_ref[:3, :3].T + T_cur_ref[:3, 3]
    noisy = X + rng.normal(0, 3e-3, (400, 3))
    points = PlanePoints(
        noisy, np.tile(T_cur_ref[:3, :3] @ normal, (400, 1)), np.full(400, 3e-3), 16.0
    )
    term = PlaneFitter(problem.camera, PlanesConfig()).term
    found = []
    for kept_px in (0.0, 0.25, 1e9):
        config = RegistrationConfig(
            kept_px=kept_px, stop_px=1e-5, stop_share=1e-5, max_rejections=9
        )
        registration = Registration(problem.camera, MatchingConfig(), config)
        reference = registration.index(problem.reference)
        start = (T @ se3.exp(np.full(6, 0.004)))[None]
        found.append(
            registration.align(reference, problem.samples, start, planes, points, term, lag)
        )
    anew, *kept = found
    assert anew.plane_points == 400
    assert anew.depth_balance > 0
    for each in kept:
        assert problems.error(anew.T_ref_cur, each.T_ref_cur)[0] < 2e-5
        assert each.sigma_depth == pytest.approx(anew.sigma_depth, rel=1e-3)
        assert each.cost == pytest.approx(anew.cost, rel=1e-3)


@pytest.mark.parametrize("cell", [20.0, 80.0])
@pytest.mark.parametrize("seed", range(3))
def test_what_depth_shares_is_that_of_the_numpy_twin(seed, cell):
    rng = np.random.default_rng(seed)
    planes, points = random_scene(rng)
    T = se3.exp(rng.normal(0, 0.05, 6))
    term = PlaneFitter(CAMERA, PlanesConfig()).term
    pinhole = kernels.Pinhole(CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy, 320, 240)
    size = int(np.ceil(240 / cell)), int(np.ceil(320 / cell))
    found = kernels.shared_depth_factor(planes, points, pinhole, T, AT_ONCE, term, 8.0, cell, *size)
    expected = twins.shared_depth_factor(planes, points, CAMERA, T, term, 8.0, cell, *size)
    assert np.isnan(expected) == (cell == 20.0)  # hardly more than one to a cell
    np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_the_equations_are_those_of_finite_differences():
    rng = np.random.default_rng(7)
    planes, points = random_scene(rng)
    T = se3.exp(rng.normal(0, 0.05, 6))
    term = PlaneFitter(CAMERA, PlanesConfig()).term
    pinhole = kernels.Pinhole(CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy, 320, 240)
    found = kernels.new_plane_matches(300)
    count = kernels.match_planes(planes, points, pinhole, T, term, found)
    sigma = 12.0
    H, b = np.empty((6, 6)), np.empty(6)
    kernels.plane_equations(found, count, sigma, H, b)
    normal, Y, r = found.normal[:, :count].T, found.Y[:, :count].T, found.residuals[:count]
    J = np.empty((count, 6))
    for k in range(6):
        delta = np.zeros(6)
        delta[k] = 1e-5
        ahead, behind = se3.exp(delta), se3.exp(-delta)
        moved = Y @ (ahead - behind)[:3, :3].T + (ahead - behind)[:3, 3]
        J[:, k] = np.einsum("ij,ij->i", normal, moved) / 2e-5
    w = np.maximum(1 - (r / sigma / kernels.TUKEY_TUNING) ** 2, 0) ** 2
    np.testing.assert_allclose(H, J.T @ (w[:, None] * J), rtol=1e-4, atol=1e-2)
    np.testing.assert_allclose(b, J.T @ (w * r), rtol=1e-4, atol=1e-2)
    # the weight is the derivative of the loss over the residual
    cost = kernels.plane_cost(found, count, 300, sigma)
    found.residuals[:count] += 1e-6
    slope = (kernels.plane_cost(found, count, 300, sigma) - cost) / 1e-6
    np.testing.assert_allclose(slope, (w * r).sum() / sigma**2, rtol=1e-4)


@pytest.mark.parametrize("count", [0, 1, kernels.LANES - 1, kernels.LANES, 2 * kernels.LANES + 3])
def test_sums_leave_out_none_and_take_no_more(count):
    rng = np.random.default_rng(count)
    near = kernels.new_plane_matches(count + 5)
    for rows in (near.Y, near.normal, near.residuals):
        rows[:] = rng.normal(size=rows.shape)
        rows[..., count:] = np.nan
    H, b, r = np.empty((6, 6)), np.empty(6), near.residuals[:count]
    kernels.plane_equations(near, count, 0.4, H, b)
    J = np.vstack((near.normal, np.cross(near.Y, near.normal, axis=0)))[:, :count]
    w = np.maximum(1 - (r / 0.4 / kernels.TUKEY_TUNING) ** 2, 0) ** 2
    np.testing.assert_allclose(H, (w * J) @ J.T, rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(b, J @ (w * r), rtol=1e-9, atol=1e-9)
    losses = [kernels.robust_cost(x * x / 0.16, kernels.TUKEY, kernels.TUKEY_TUNING) for x in r]
    worst = kernels.TUKEY_TUNING**2 / 6
    assert kernels.plane_cost(near, count, count + 2, 0.4) == pytest.approx(sum(losses) + 2 * worst)


def lying_on(planes, rng, off_m):
    """Points on planes, seen from a camera that has moved, and where that is."""
    cells = np.flatnonzero(planes.offsets > 0)
    row, col = np.divmod(cells, planes.cols)
    rays = CAMERA.backproject(planes.step * np.stack([col, row], 1), np.ones(len(cells)))
    normals, offsets = planes.normals[cells], planes.offsets[cells]
    Y = rays * (offsets / np.einsum("ij,ij->i", normals, rays))[:, None]
    T = se3.exp(rng.normal(0, off_m, 6))
    back = se3.inverse(T)
    X = Y @ back[:3, :3].T + back[:3, 3] + rng.normal(0, 5e-4, Y.shape)
    return PlanePoints(X, normals @ back[:3, :3].T, np.full(len(X), 0.005), 32.0), T


@pytest.mark.parametrize("ways", [1, 3, 6])
@pytest.mark.parametrize("off_m", [0.003, 0.01])
def test_the_descent_on_planes_equals_its_numpy_twin(ways, off_m):
    for seed in range(4):
        rng = np.random.default_rng(seed)
        planes, _ = random_scene(rng)
        points, truth = lying_on(planes, rng, off_m)
        basis, _ = np.linalg.qr(rng.normal(size=(6, ways)))
        solver = Registration(CAMERA, MatchingConfig(), RegistrationConfig()).solver
        term = PlaneFitter(CAMERA, PlanesConfig()).term
        pinhole = kernels.Pinhole(CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy, 320, 240)
        T = np.eye(4)
        given = term, basis, 0.5, solver, 1e-5
        steps, reason = kernels.descend_on_planes(planes, points, pinhole, *given, T)
        its_T, its_steps, converged = twins.descend_on_planes(
            planes, points, CAMERA, *given, np.eye(4)
        )
        assert steps == its_steps > 1
        assert (reason == kernels.CONVERGED) == converged
        np.testing.assert_allclose(T, its_T, atol=1e-9)
        if ways == 6:
            before, after = (se3.log(se3.inverse(truth) @ each) for each in (np.eye(4), T))
            assert np.linalg.norm(after) < 0.4 * np.linalg.norm(before)
        else:  # elsewhere it may not move
            left = np.eye(6) - basis @ basis.T
            assert np.abs(left @ se3.log(T)).max() < 0.1 * off_m


def test_where_planes_say_nothing_of_a_direction_the_descent_stays():
    """Along a wall nothing changes."""
    normals = np.tile([0.0, 0.0, 1.0], (80, 1))
    planes = PlaneMap(normals, np.full(80, 1.5), 8, 10, 32.0)
    points, _ = lying_on(planes, np.random.default_rng(0), 0.003)
    solver = Registration(CAMERA, MatchingConfig(), RegistrationConfig()).solver
    term = PlaneFitter(CAMERA, PlanesConfig()).term
    pinhole = kernels.Pinhole(CAMERA.fx, CAMERA.fy, CAMERA.cx, CAMERA.cy, 320, 240)
    T = np.eye(4)
    along = np.ascontiguousarray(np.eye(6)[:, :1])
    found = kernels.descend_on_planes(planes, points, pinhole, term, along, 0.5, solver, 1e-5, T)
    assert found == (0, kernels.SINGULAR)
    np.testing.assert_array_equal(T, np.eye(4))


@pytest.fixture(scope="module")
def panels():
    """Plain panels, seen by a noisy sensor."""
    source = SyntheticSource(make_recipe("notexture_near", frames=24, seed=2))
    return source, [source.read(i).frame for i in range(24)]


def last_error(source, frames, config):
    odometry = Odometry(source.camera, config)
    tracked = [odometry.track(frame) for frame in frames]
    assert all(frame.status is not Status.LOST for frame in tracked)
    truth = [source.ground_truth.at(frame.timestamp) for frame in frames]
    errors = [
        np.linalg.norm((se3.inverse(se3.inverse(truth[0]) @ T) @ t.T_world_cam)[:3, 3])
        for T, t in zip(truth, tracked, strict=True)
    ]
    return float(np.sqrt(np.mean(np.square(errors)))), tracked


def test_depth_steadies_what_edges_leave_open(panels):
    alone, _ = last_error(*panels, Config().with_overrides(["planes.weight=0"]))
    both, tracked = last_error(*panels, Config())
    assert both < 0.9 * alone
    assert both < 0.0005
    assert tracked[-1].alignment.plane_points > 300
    _, tracked = last_error(*panels, Config().with_overrides([FIXED]))
    found = tracked[-1].alignment
    assert 0.1 < found.sigma_depth < 1.0
    limits = Config().planes
    edges_doubt = (limits.edge_doubt_px / found.sigma_px) ** 2
    expected = limits.weight / (1 + found.sigma_depth / limits.doubt) * (1 + edges_doubt)
    assert found.depth_balance == pytest.approx(expected, rel=0.1)  # of the last step but one


def test_what_edges_err_by_together_is_what_depth_gains(panels):
    """The better edges fit, the more it matters; without that doubt they never count less."""
    source, frames = panels
    balance = []
    for doubt in (0.0, 0.4, 0.8):
        config = Config().with_overrides([f"planes.edge_doubt_px={doubt}"])
        odometry = Odometry(source.camera, config)
        balance.append([odometry.track(frame) for frame in frames[:4]][-1].alignment)
    assert 0 < balance[0].depth_balance < 1
    assert balance[0].depth_balance < balance[1].depth_balance < balance[2].depth_balance


def test_without_the_term_depth_counts_nothing(panels):
    source, frames = panels
    odometry = Odometry(source.camera, Config.preset("paper"))
    tracked = [odometry.track(frame) for frame in frames[:3]]
    assert tracked[-1].alignment.plane_points == 0
    assert tracked[-1].alignment.depth_balance == 0


def test_the_more_its_residuals_exceed_the_noise_the_less_depth_counts(panels):
    source, frames = panels
    balance = []
    for size in (0.0, 0.02, 0.06):
        bent = []
        for k, frame in enumerate(frames[:4]):  # what no rigid motion explains, other each time
            v, u = np.mgrid[: source.camera.height, : source.camera.width]
            wave = 1 + size * np.sin(u / 60.0 + k) * np.sin(v / 60.0 + 2 * k)
            depth = (frame.depth * wave).astype(np.float32)
            bent.append(type(frame)(frame.timestamp, frame.grey, depth))
        rules = [FIXED, "planes.depth_doubt_rule=none"]
        odometry = Odometry(source.camera, Config().with_overrides(rules))
        balance.append([odometry.track(frame) for frame in bent][-1].alignment.depth_balance)
    assert balance[0] > 1.3 * balance[1] > 1.3**2 * balance[2]


def tukey(r, tuning):
    return (tuning**2 / 6 * (1 - np.maximum(0, 1 - (r / tuning) ** 2) ** 3)).sum()


def imbalance(registration, source, reference, samples, planes, points, term, found):
    """Gradient of both terms together where a registration ended, over that of the smaller one."""
    solver, camera, T = registration._solver, registration._pinhole, found.T_ref_cur
    n, m = len(samples), len(points.sigma)
    matches, residuals = kernels.new_matches(n), np.empty(n)
    kernels.warp_and_match(
        reference.grid,
        NOTHING_NEAR,
        kernels.ROBUST,
        samples.points(source.camera),
        samples.gradients,
        kernels.ALL,
        camera,
        T,
        registration._normal,
        solver.residual,
        matches,
        residuals,
    )
    near = kernels.new_plane_matches(m)
    near_count = kernels.match_planes(planes, points, camera, T, term, near)
    matched = matches.edge >= 0
    Y, normal = matches.Y[matched], matches.normal[matched] * found.trust[matched, None]
    edges = reference.grid.points[matches.edge[matched], :2]
    near_Y, across = near.Y[:, :near_count].T, near.normal[:, :near_count].T
    offsets = np.einsum("ij,ij->i", across, near_Y) - near.residuals[:near_count]

    def costs(delta):
        """Mean losses of edges and of planes, for one and the same matches and scales."""
        move = se3.exp(delta)
        y = Y @ move[:3, :3].T + move[:3, 3]
        pixels = y[:, :2] / y[:, 2:] * [camera.fx, camera.fy] + [camera.cx, camera.cy]
        r = np.einsum("ij,ij->i", normal, pixels - edges) / found.sigma_px
        by_edges = tukey(r, solver.tuning) / n
        y = near_Y @ move[:3, :3].T + move[:3, 3]
        r = (np.einsum("ij,ij->i", across, y) - offsets) / found.sigma_depth
        return np.array([by_edges, found.depth_balance / n * tukey(r, kernels.TUKEY_TUNING)])

    h = 1e-6
    slopes = np.array([costs(h * e) - costs(-h * e) for e in np.eye(6)]) / (2 * h)
    # a length that does not depend on the units of the directions
    measure = np.linalg.inv(found.H)
    by_edges, by_planes = (np.sqrt(g @ measure @ g) for g in slopes.T)
    both = slopes.sum(axis=1)
    assert solver.weight == kernels.TUKEY
    assert found.depth_balance > 0
    return np.sqrt(both @ measure @ both) / min(by_edges, by_planes)


def test_a_registration_ends_where_the_gradient_of_the_two_terms_vanishes(panels):
    source, frames = panels
    config = Config().with_overrides(
        [
            "registration.stop_px=1e-6",
            "registration.stop_decrease=0",
            "registration.max_iterations=200",
            "registration.max_rejections=20",
            "registration.kept_px=0",
            "planes.weight=1",
            "motion.depth_delay=none",
            "motion.readout=none",
        ]
    )
    given = []
    align = Registration.align

    def keep(self, *arguments, **options):
        given.append((self, arguments, align(self, *arguments, **options)))
        return given[-1][2]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Registration, "align", keep)
        odometry = Odometry(source.camera, config)
        for frame in frames:
            odometry.track(frame)
    rest = []
    for registration, (reference, samples, _, planes, points, term, _), found in given:
        # Others end between two sets of matches, where every step that is not tiny is rejected.
        if found.steps()[-1].damping > 0.1:
            continue
        rest.append(
            imbalance(registration, source, reference, samples, planes, points, term, found)
        )
    assert rest
    assert max(rest) < 1e-3
