"""Looking farther afield where a registration is in doubt."""

from dataclasses import replace

import numpy as np
import pytest

from edvo import chamfer, se3
from edvo.chamfer import Guess
from edvo.config import Config
from edvo.doubt import STEPPED
from edvo.edges import extract_edges
from edvo.frame import Frame
from edvo.locating import NOT_ALONE
from edvo.odometry import Odometry, Status
from edvo.places import Found, Place
from edvo.sampling import sample_edges
from edvo.seen import Seen
from edvo.synthesis.sequence import SyntheticSource, make_recipe
from edvo.trajectory import Trajectory

YAW_DEG = 13.0
PERIOD = 1 / 30


@pytest.fixture(scope="module")
def apart(tmp_path_factory):
    """Two frames of a cabinet that a turn of the camera lies between, and that motion."""
    start = make_recipe("cabinet", frames=1).truth().poses[0]
    turn = se3.exp(np.array([0.05, 0.0, 0.02, 0.0, np.radians(YAW_DEG), 0.0]))
    path = tmp_path_factory.mktemp("path") / "path.txt"
    times = [0.0, PERIOD]
    Trajectory.from_poses(times, [start, start @ turn]).write(path)
    source = SyntheticSource(make_recipe("cabinet", frames=2, trajectory=path))
    frames = [source.read(i).frame for i in range(2)]
    T = source.ground_truth
    truth = se3.inverse(T.at(frames[0].timestamp)) @ T.at(frames[1].timestamp)
    return source.camera, frames, truth


def second(apart, *overrides, after=0.5):
    camera, frames, truth = apart
    odometry = Odometry(camera, Config().with_overrides(overrides))
    odometry.track(frames[0])
    # a hand does not turn so far in a thirtieth of a second
    result = odometry.track(Frame(frames[0].timestamp + after, frames[1].grey, frames[1].depth))
    off = se3.inverse(truth) @ result.T_key_cur
    return result, np.linalg.norm(off[:3, 3]), np.degrees(se3.rotation_angle(off))


def test_a_turn_too_wide_for_the_edges_is_found(apart):
    near, *_ = second(apart, "motion.search_deg=0")
    assert near.status is not Status.TRACKED
    wide, distance, angle = second(apart)
    assert wide.status is not Status.LOST
    assert distance < 0.01
    assert angle < 0.5


def test_no_search_where_a_glance_tells_of_no_other_place(apart):
    camera, frames, _ = apart
    odometry = Odometry(camera)
    odometry.track(frames[0])
    key = odometry._course.keyframe
    known = {"samples": key.samples, "points": key.points, "is_near": False}
    seen = type("Seen", (), known)
    perfect = odometry._search._register(key, key.samples, key.points, np.eye(4))
    odometry._search._register = None  # may not be called
    assert odometry._search.around(key, np.eye(4), seen, perfect) is perfect


def test_the_search_never_makes_it_worse(began, monkeypatch):
    odometry, seen, truth = began
    key, search = odometry._course.keyframe, odometry._search
    right = search._register(key, seen.samples, seen.points, truth)
    astray = se3.exp(np.array([0.0, 0.0, 0.0, 0.0, np.radians(-20.0), 0.0]))
    monkeypatch.setattr(key.chamfer, "likely", lambda *given: [Guess(256.0, astray)])
    assert search.around(key, np.eye(4), seen, right) is right


def test_a_step_higher_it_is_told_that_another_place_fits(stairs):
    odometry, seen, truth = stairs
    key, search = odometry._course.keyframe, odometry._search
    aside = np.array([se3.exp(np.array([*way, 0.0, 0.0, 0.0])) for way in 0.33 * np.eye(3)])
    steps = key.chamfer.beside(seen.samples, truth @ aside)
    wrong = next(g.T_ref_cur for g in steps if np.linalg.norm((g.T_ref_cur - truth)[:3, 3]) > 0.2)
    assert not search.is_alone(key, wrong, seen)
    assert search.is_alone(key, truth, seen)


def test_a_cabinet_is_told_from_what_is_beside_it(began):
    odometry, seen, truth = began
    assert odometry._search.is_alone(odometry._course.keyframe, truth, seen)


def test_a_far_step_that_fits_elsewhere_too_is_degraded(apart, monkeypatch):
    camera, frames, _ = apart
    odometry = Odometry(camera)
    odometry.track(frames[0])
    monkeypatch.setattr(odometry._search, "is_alone", lambda *given: False)
    soon = odometry.track(shaken(frames[0], 1))
    assert soon.status is Status.TRACKED  # not far
    later = odometry.track(Frame(frames[0].timestamp + 0.6, frames[0].grey, frames[0].depth))
    assert later.status is Status.DEGRADED
    assert later.reason == NOT_ALONE


def shaken(frame, k):
    """The same view again, but for noise, in depth less than counts: else it is a repeat."""
    noise = np.random.default_rng(k).integers(-1, 2, frame.grey.shape)
    grey = np.clip(frame.grey + noise, 0, 255).astype(np.uint8)
    return Frame(frame.timestamp + k * PERIOD, grey, frame.depth * np.float32(1 + 1e-6 * k))


def at_rest(apart):
    """A tracker that has seen the first view four times, and the views."""
    camera, frames, _ = apart
    odometry = Odometry(camera)
    for k in range(4):
        odometry.track(shaken(frames[0], k))
    return odometry, frames


def test_no_search_without_doubt_but_for_the_first_registration(apart):
    """Nothing is known then that it could be held against."""
    camera, frames, _ = apart
    odometry = Odometry(camera)
    calls = []

    def around(key, T_key_start, seen, found):
        calls.append(found)
        return found

    odometry._search.around = around
    for k in range(4):
        assert odometry.track(shaken(frames[0], k)).status is Status.TRACKED
    assert len(calls) == 1


def test_what_is_tracked_is_only_left_for_what_is_clearly_sharper(apart, monkeypatch):
    camera, frames, _ = apart
    for scatter, is_left in ((0.1, True), (1.0, False), (20.0, False)):
        odometry = Odometry(camera)
        odometry.track(frames[0])
        others = []

        def around(key, T_key_start, seen, found, scatter=scatter, others=others):
            others.append(replace(found, residuals=found.residuals * scatter))
            return others[-1]

        monkeypatch.setattr(odometry._search, "around", around)
        result = odometry.track(shaken(frames[0], 1))
        assert result.status is Status.TRACKED
        assert (result.alignment is others[0]) == is_left


def test_in_doubt_a_frame_is_looked_at_widely_before_it_is_searched_for(apart, monkeypatch):
    odometry, frames = at_rest(apart)
    align, wide = odometry._registration.align, []

    def narrow(*given, first_sigma_px=0.0, **options):
        found = align(*given, first_sigma_px=first_sigma_px, **options)
        if first_sigma_px:
            wide.append(found)
            return found
        return replace(found, residuals=found.residuals + 3, inliers=found.inliers // 2)

    monkeypatch.setattr(odometry._registration, "align", narrow)
    monkeypatch.setattr(odometry._search, "around", lambda *given: pytest.fail("searched for"))
    result = odometry.track(shaken(frames[0], 4))
    assert result.status is Status.TRACKED
    assert len(wide) == 1
    assert result.alignment is wide[0]


@pytest.mark.parametrize(("fitting", "is_asked"), [(0.7, True), (0.85, False)])
def test_a_frame_that_fits_far_less_at_once_is_looked_at_widely(
    apart, monkeypatch, fitting, is_asked
):
    """Though most of it does, and it would be tracked."""
    odometry, frames = at_rest(apart)
    align, wide = odometry._registration.align, []

    def narrow(*given, first_sigma_px=0.0, **options):
        found = align(*given, first_sigma_px=first_sigma_px, **options)
        wide.append(first_sigma_px)
        n = len(found.matches)
        return found if first_sigma_px else replace(found, inliers=int(fitting * n))

    monkeypatch.setattr(odometry._registration, "align", narrow)
    monkeypatch.setattr(odometry._search, "around", lambda *given: pytest.fail("searched for"))
    result = odometry.track(shaken(frames[0], 4))
    assert result.status is Status.TRACKED
    assert (2.0 in wide) == is_asked
    usual = odometry._judge.scatter
    assert usual.fits_less(replace(result.alignment, inliers=0))
    assert not usual.fits_less(replace(result.alignment, inliers=len(result.alignment.matches)))


def test_what_tells_places_at_a_glance_is_made_with_the_first_frame(apart, monkeypatch):
    """The next frame asks for it, and has enough to do."""
    camera, frames, _ = apart
    made = []
    image = chamfer.score_image
    monkeypatch.setattr(chamfer, "score_image", lambda *given: made.append(k) or image(*given))
    for change, expected in (("motion.search_deg=20", [0]), ("motion.search_deg=0", [])):
        odometry = Odometry(camera, Config().with_overrides([change]))
        made.clear()
        for k in range(2):
            odometry.track(shaken(frames[0], k))
        assert made == expected


@pytest.mark.parametrize("promises", [False, True])
def test_the_first_registration_is_looked_at_widely_where_a_few_edges_promise(
    apart, monkeypatch, promises
):
    """Of few edges and points, which take half of the time."""
    camera, frames, _ = apart
    odometry = Odometry(camera)
    odometry.track(frames[0])
    align, wide = odometry._registration.align, []

    def watched(reference, samples, starts, planes, points, *rest, first_sigma_px=0.0, **options):
        given = reference, samples, starts, planes, points, *rest
        found = align(*given, first_sigma_px=first_sigma_px, **options)
        if first_sigma_px:
            wide.append((len(samples), len(points.sigma), found))
            return found
        # else as if two in five of its edges were of none of the keyframe
        off = np.where(np.arange(len(found.matches)) % 5 < 2, 1.9, found.residuals)
        return replace(found, residuals=off) if promises else found

    monkeypatch.setattr(odometry._registration, "align", watched)
    monkeypatch.setattr(odometry._search, "around", lambda *given: given[-1])
    result = odometry.track(shaken(frames[0], 1))
    assert result.status is Status.TRACKED
    edges, points = len(result.alignment.matches), len(odometry._course.keyframe.points.sigma)
    assert wide[0][0] < 0.3 * edges
    assert wide[0][1] < 0.3 * points
    assert [n > 0.9 * edges for n, _, _ in wide] == ([False, True] if promises else [False])
    assert (result.alignment is wide[-1][2]) == promises


@pytest.mark.parametrize(
    ("changes", "is_taken"),
    [({}, True), ({"converged": False}, False), ({"sigma_depth": 4.0}, False)],
)
def test_a_tracked_frame_is_only_left_for_what_is_tracked_and_clearer(
    apart, monkeypatch, changes, is_taken
):
    """And is not searched for then."""
    odometry, frames = at_rest(apart)
    align, wide = odometry._registration.align, []

    def less(*given, first_sigma_px=0.0, **options):
        found = align(*given, first_sigma_px=first_sigma_px, **options)
        if first_sigma_px:
            wide.append(replace(found, **changes))
            return wide[-1]
        n = len(found.matches)
        off = np.where(np.arange(n) % 10 < 3, 5.0, found.residuals)
        return replace(found, residuals=off, inliers=int(0.7 * n))

    monkeypatch.setattr(odometry._registration, "align", less)
    monkeypatch.setattr(odometry._search, "around", lambda *given: pytest.fail("searched for"))
    result = odometry.track(shaken(frames[0], 4))
    assert result.status is Status.TRACKED
    assert len(wide) == 1
    assert (result.alignment is wide[0]) == is_taken


def test_with_one_stage_there_is_nothing_to_begin_wider(apart, monkeypatch):
    camera, frames, _ = apart
    for change in ("matching.criterion=robust", "registration.first_sigma_px=2"):
        odometry = Odometry(camera, Config().with_overrides([change]))
        odometry.track(frames[0])
        monkeypatch.setattr(odometry._judge, "_poor_fit", lambda alignment: "in doubt")
        align = odometry._registration.align

        def once(*given, first_sigma_px=0.0, align=align, **options):
            assert not first_sigma_px
            return align(*given, **options)

        monkeypatch.setattr(odometry._registration, "align", once)
        assert odometry.track(shaken(frames[0], 1)).status is Status.DEGRADED


def test_where_depth_contradicts_the_edges_a_doubtful_frame_is_lost(apart):
    strict = ["status.doubt_inliers=1.0", "status.max_depth_sigma=1e-3"]
    result, *_ = second(apart, *strict, after=0.1)  # too soon for a far step
    assert result.status is Status.LOST
    assert "depth contradicts the edges" in result.reason


@pytest.fixture(scope="module")
def began(apart):
    camera, frames, truth = apart
    odometry = Odometry(camera)
    odometry.track(frames[0])
    edges = extract_edges(frames[1].grey, odometry.config.edges)
    samples = sample_edges(
        edges, frames[1].depth, camera, odometry.config.sampling, odometry.config.edges, 1
    )
    seen = Seen(frames[1], edges, samples, odometry._fitter.points(frames[1].depth))
    return odometry, seen, truth


@pytest.fixture(scope="module")
def stairs(tmp_path_factory):
    """A frame of stairs, and how it would be seen by a camera that has hardly moved."""
    source = SyntheticSource(make_recipe("stairs", frames=2))
    odometry = Odometry(source.camera)
    frames = [source.read(i).frame for i in range(2)]
    odometry.track(frames[0])
    edges = extract_edges(frames[1].grey, odometry.config.edges)
    samples = sample_edges(
        edges, frames[1].depth, source.camera, odometry.config.sampling, odometry.config.edges, 1
    )
    T = [source.ground_truth.at(frame.timestamp) for frame in frames]
    seen = Seen(frames[1], edges, samples, odometry._fitter.points(frames[1].depth))
    return odometry, seen, se3.inverse(T[0]) @ T[1]


def test_a_far_step_is_found_from_a_start_that_is_off(began):
    odometry, seen, truth = began
    turned = se3.exp(np.array([0.0, 0.0, 0.0, 0.0, np.radians(-7.0), 0.0]))
    key = odometry._course.keyframe
    from_there = odometry._registration.align(key.edges, seen.samples, turned[None])
    assert np.linalg.norm((se3.inverse(truth) @ from_there.T_ref_cur)[:3, 3]) > 0.05
    found = odometry._search.farther(key, turned, seen, 0.5)
    off = se3.inverse(truth) @ found.T_ref_cur
    assert np.linalg.norm(off[:3, 3]) < 0.01
    assert np.degrees(se3.rotation_angle(off)) < 0.5


def test_another_place_is_not_a_far_step(began):
    odometry, _, _ = began
    source = SyntheticSource(make_recipe("texture_near", frames=1, camera=odometry.camera))
    frame, config = source.read(0).frame, odometry.config
    edges = extract_edges(frame.grey, config.edges)
    samples = sample_edges(edges, frame.depth, odometry.camera, config.sampling, config.edges, 1)
    seen = Seen(frame, edges, samples, odometry._fitter.points(frame.depth))
    assert odometry._search.farther(odometry._course.keyframe, np.eye(4), seen, 0.5) is None


def test_of_edges_only_those_in_view_have_to_be_explained(began):
    odometry, _, _ = began
    key, search = odometry._course.keyframe, odometry._search
    same = search._register(key, key.samples, key.points, np.eye(4))
    assert search._hunter._explained(same, key.samples, key.edges) > 0.99
    half = se3.exp(np.array([0.0, 0.0, 0.0, 0.0, np.radians(25.0), 0.0]))  # half a view aside
    residuals = np.zeros(len(key.samples))
    camera = odometry.camera
    points = key.samples.points(camera) @ half[:3, :3].T
    u = camera.fx * points[:, 0] / points[:, 2] + camera.cx
    residuals[u >= camera.width - 1] = 9.0
    aside = replace(same, T_ref_cur=half, residuals=residuals)
    assert np.isclose(search._hunter._explained(aside, key.samples, key.edges), 1.0)
    worse = replace(aside, residuals=residuals + 9.0)
    assert search._hunter._explained(worse, key.samples, key.edges) == 0.0
    dark = replace(key.samples, gradients=-key.samples.gradients)  # turned round: another's
    assert search._hunter._explained(aside, dark, key.edges) == 0.0
    assert np.isclose(search._hunter._explained(aside, dark), 1.0)


@pytest.mark.parametrize(("worth", "is_found"), [(0.9, False), (0.3, True)])
def test_of_two_places_that_fit_neither_is_taken(began, monkeypatch, worth, is_found):
    """One fits fully, the other, a metre away, by a share of that."""
    odometry, seen, truth = began
    key, search = odometry._course.keyframe, odometry._search
    found = search._register(key, seen.samples, seen.points, truth)
    elsewhere = truth.copy()
    elsewhere[0, 3] += 1.0
    away, hunt = replace(found, T_ref_cur=elsewhere), search._hunter.hunt(seen, [np.eye(4)], 1.0)
    places = [
        Place(1.0, truth, key, found, 0.8, True, hunt, False),
        Place(worth, elsewhere, key, away, 0.8, True, hunt, False),
    ]
    monkeypatch.setattr(search, "_glance", lambda *given: [])
    monkeypatch.setattr(search._hunter, "promising", lambda *given: [])
    looked = iter([places[:1], places[1:]])  # the second one is found beside the first
    monkeypatch.setattr(search._hunter, "look_closely", lambda *given: next(looked))
    result = search.everywhere(odometry._upkeep.store, key, seen, [np.eye(4)], 1.0)
    assert (result is not None) == is_found
    assert len(search._rivals) == (0 if is_found else 2)
    search._rivals = []


def test_found_again_from_a_doubtful_pose_is_degraded_for_a_second(apart):
    camera, frames, _ = apart
    odometry = Odometry(camera)
    odometry.track(frames[0])
    key = odometry._course.keyframe
    odometry._doubt.is_sure = False
    t = frames[0].timestamp
    for k in range(3):
        odometry.skip(t + 0.2 * k, "no depth")
    found = odometry._search._register(key, key.samples, key.points, np.eye(4))
    odometry._search.everywhere = lambda store, last, seen, *given, **more: Found(
        key, found, seen, None, False
    )
    rng = np.random.default_rng(0)
    states = {}
    for after in (0.0, 0.5, 1.1):
        noise = rng.integers(-1, 2, frames[0].grey.shape)
        grey = np.clip(frames[0].grey + noise, 0, 255).astype(np.uint8)
        states[after] = odometry.track(Frame(t + 0.7 + after, grey, frames[0].depth)).status
    assert states == {0.0: Status.DEGRADED, 0.5: Status.DEGRADED, 1.1: Status.TRACKED}


def test_after_a_step_that_fits_elsewhere_too_poses_are_in_doubt(apart, monkeypatch):
    camera, frames, _ = apart
    odometry = Odometry(camera)
    odometry.track(frames[0])
    monkeypatch.setattr(odometry._search, "is_alone", lambda *given: False)
    rng = np.random.default_rng(0)
    states = []
    for after in (0.6, 0.63, 1.7):
        noise = rng.integers(-1, 2, frames[0].grey.shape)
        grey = np.clip(frames[0].grey + noise, 0, 255).astype(np.uint8)
        monkeypatch.setattr(odometry._search, "is_alone", lambda *given: len(states) > 0)
        states.append(odometry.track(Frame(frames[0].timestamp + after, grey, frames[0].depth)))
    assert [state.reason for state in states] == [NOT_ALONE, STEPPED, ""]


def test_a_far_step_found_by_a_search_is_looked_at_once_more(apart, monkeypatch):
    camera, frames, _ = apart
    odometry = Odometry(camera)
    odometry.track(frames[0])
    key, search = odometry._course.keyframe, odometry._search
    right = search._register(key, key.samples, key.points, np.eye(4))
    bad = replace(right, inliers=0, residuals=np.full_like(right.residuals, 9.0))
    monkeypatch.setattr(odometry._registration, "align", lambda *given, **options: bad)
    monkeypatch.setattr(search, "around", lambda *given: right)
    monkeypatch.setattr(search, "is_alone", lambda *given: False)
    noise = np.random.default_rng(0).integers(-1, 2, frames[0].grey.shape)
    grey = np.clip(frames[0].grey + noise, 0, 255).astype(np.uint8)
    result = odometry.track(Frame(frames[0].timestamp + 0.6, grey, frames[0].depth))
    assert (result.status, result.reason) == (Status.DEGRADED, NOT_ALONE)
