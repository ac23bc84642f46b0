"""Edges that scatter at once: light makes new ones and turns others round, and moves none."""

from dataclasses import replace

import numpy as np
import pytest

from edvo import se3
from edvo.config import Config, MatchingConfig, RegistrationConfig
from edvo.odometry import Odometry, Status
from edvo.registration import FAILURES, Registration
from edvo.scatter import CROWDS_PX, RANGE_PX, SHARES, clarity, is_clearer, is_sharper
from edvo.status import Judge
from edvo.synthesis.sequence import SyntheticSource, make_recipe

from . import problems
from .test_doubt import NOT_ASKED, dense

SPEED, TURN = 0.5, 10.0  # of a hand
LEFT = "status.edge_jump=0"


@pytest.fixture(scope="module")
def crisp():
    """A registration of crisp edges, all of which fit."""
    problem = problems.segments_problem(0, se3.exp([0.01, 0.0, 0.01, 0.0, 0.01, 0.0]))
    registration = Registration(problem.camera, MatchingConfig(), RegistrationConfig())
    found = registration.align(
        registration.index(problem.reference), problem.samples, np.eye(4)[None]
    )
    residuals = np.full(len(found.matches), 0.1)
    depth = {"plane_points": 800, "plane_inliers": 790, "plane_area": 0.6}
    return replace(found, residuals=residuals, sigma_px=0.2, **depth)


def judging(alignment, *overrides, frames=30):
    judge = Judge(Config().with_overrides(overrides))
    for _ in range(frames):
        judge.note(alignment)
    return judge


def partly(alignment, inliers, agreeing, sigma_px=0.3):
    """So large shares of the samples fit, of which all are in their places, and agree."""
    n = len(alignment.matches)
    residuals = np.where(np.arange(n) < inliers * n, 0.1, 8.0)
    counts = {"inliers": round(inliers * n), "agreeing": round(agreeing * n)}
    return replace(alignment, residuals=residuals, sigma_px=sigma_px, **counts)


# ---------------------------------------------------------------------------------- the judge


def test_what_is_scattered_is_told_from_the_usual(crisp):
    judge = judging(crisp)
    assert not judge.scatter.is_wide(replace(crisp, sigma_px=0.49))
    assert judge.scatter.is_wide(replace(crisp, sigma_px=0.51))
    assert not judging(crisp, LEFT).scatter.is_wide(replace(crisp, sigma_px=5.0))
    assert judge.scatter.sharp_px == pytest.approx(0.4)


def test_nothing_is_scattered_before_the_usual_is_known(crisp):
    assert not judging(crisp, frames=0).scatter.is_wide(replace(crisp, sigma_px=50.0))


def test_the_usual_is_that_of_late(crisp):
    judge = judging(crisp)
    for _ in range(30):
        judge.note(replace(crisp, sigma_px=0.6))
    assert not judge.scatter.is_wide(replace(crisp, sigma_px=1.3))


def test_edges_in_their_places_are_counted(crisp):
    some = crisp.residuals.copy()
    some[:7], some[7:9] = 0.61, np.nan  # beyond three times the usual; without a match
    assert judging(crisp).scatter.in_place(replace(crisp, residuals=some)) == len(some) - 9


def crowded(alignment, share, width_px, seed=0):
    """So large a share of the edges in a crowd so wide, the others anywhere within 6 px."""
    rng = np.random.default_rng(seed)
    n = len(alignment.matches)
    residuals = np.where(np.arange(n) < share * n, rng.normal(0, width_px, n), rng.uniform(0, 6, n))
    return replace(alignment, residuals=residuals)


def test_clarity_is_the_likelihood_of_the_likeliest_crowd(crisp):
    for share, width_px in ((0.9, 0.2), (0.5, 0.4), (0.7, 1.2)):
        found = crowded(crisp, share, width_px)
        found.residuals[::50] = np.nan
        r = np.abs(np.where(np.isnan(found.residuals), np.inf, found.residuals))
        r = np.where(r < RANGE_PX, r, np.inf)
        best = -np.inf
        for width in CROWDS_PX:
            normal = 2 * np.exp(-((r / width) ** 2) / 2) / np.sqrt(2 * np.pi) / width
            for part in SHARES:
                best = max(best, np.log(part * normal + (1 - part) / RANGE_PX).sum())
        assert clarity(found) == pytest.approx(best, abs=0.01 * len(r))  # it takes them by bins
        few = replace(found, residuals=found.residuals[::4])
        assert clarity(found, 4) == clarity(few)
    assert clarity(replace(crisp, reason=FAILURES[1])) == -np.inf


def test_a_narrow_crowd_is_clearer_than_a_wide_one_of_more_edges(crisp):
    """What a median takes for no better: 63 % to 0.36 px, and 77 % to 0.97 px."""
    narrow, wide = crowded(crisp, 0.63, 0.36), crowded(crisp, 0.77, 0.97)
    assert clarity(narrow) > clarity(wide) + 50
    assert clarity(crowded(crisp, 0.97, 0.97)) > clarity(crowded(crisp, 0.2, 0.2))
    assert clarity(crowded(crisp, 0.8, 0.5)) > clarity(crowded(crisp, 0.6, 0.5))


@pytest.mark.parametrize(("more", "is_it"), [(10.1, True), (9.9, False)])
def test_of_few_edges_as_much_less_is_clear(crisp, monkeypatch, more, is_it):
    asked = []

    def told(alignment, stride=1):
        asked.append(stride)
        return 50.0 if alignment is crisp else 50.0 + more / scale

    monkeypatch.setattr("edvo.scatter.clarity", told)
    for scale in (1, 4):
        assert is_clearer(replace(crisp), crisp, scale) == is_it
        assert asked == [1, scale]
        asked.clear()


def test_sharper_is_clearer_with_depth_no_worse(crisp):
    before, more = crowded(crisp, 0.77, 0.97), crowded(crisp, 0.63, 0.36)
    assert is_sharper(more, before)
    assert not is_sharper(before, more)
    assert not is_sharper(before, before)
    assert not is_sharper(replace(more, plane_points=700), before)
    assert is_clearer(replace(more, plane_points=700), before)
    assert not is_clearer(before, more)
    few = replace(more, residuals=more.residuals[::4], plane_points=200)  # of all of which others
    assert is_sharper(few, before, 4)
    assert not is_sharper(few, more, 4)
    assert not is_sharper(replace(few, plane_points=175), before, 4)
    assert not is_sharper(replace(more, sigma_depth=crisp.sigma_depth + 1), before)
    assert not is_sharper(replace(more, reason=FAILURES[1]), before)


def test_hardly_clearer_is_no_sharper(crisp):
    """Two crowds may be all but alike, one of them a centimetre off."""
    before = crowded(crisp, 0.6, 0.4)
    wide = np.flatnonzero(before.residuals > 2)
    for moved, sharper in ((1, False), (4, False), (6, True)):
        residuals = before.residuals.copy()
        residuals[wide[:moved]] = 0.1
        after = replace(before, residuals=residuals)
        assert 0 < clarity(after) - clarity(before) < 15
        assert is_sharper(after, before) == sharper


@pytest.mark.parametrize("finer", ["measured", "none"])
def test_the_usual_depth_is_an_area_not_a_count(finer):
    """Points that lie closely stand for less each."""
    frames, _ = problems.sequence(30)
    odometry = Odometry(problems.CAMERA, Config().with_overrides([f"planes.finer={finer}"]))
    found = [odometry.track(frame).alignment for frame in frames[:20]][1:]
    counts, areas = np.array([(each.plane_points, each.plane_area) for each in found]).T
    assert (counts[-1] > 2.5 * counts[0]) == (finer == "measured")
    assert np.abs(np.diff(areas)).max() < 0.08
    assert 0.3 < areas.mean() < 1


@pytest.mark.parametrize(("inliers", "agreeing"), [(0.45, 0.44), (0.9, 0.3)])
def test_enough_edges_in_their_places_are_degraded_not_lost(crisp, inliers, agreeing):
    seen = partly(crisp, inliers, agreeing)
    status, reason = judging(crisp).judge(seen, SPEED, TURN, follows=True)
    assert status is Status.DEGRADED
    assert "% of the samples fit" in reason
    for judge, follows in (
        (judging(crisp), False),  # after a gap it may be anywhere
        (judging(crisp, LEFT), True),
        (judging(crisp, frames=0), True),
    ):
        assert judge.judge(seen, SPEED, TURN, follows=follows)[0] is Status.LOST


def test_what_comes_before_the_lens_is_no_light(crisp):
    judge, seen = judging(crisp), partly(crisp, 0.45, 0.44, sigma_px=0.6)
    assert judge.scatter.is_wide(seen)
    hand = replace(seen, plane_area=0.45)
    assert not judge.scatter.is_wide(hand)
    assert judge.judge(seen, SPEED, TURN, follows=True)[0] is Status.DEGRADED
    assert judge.judge(hand, SPEED, TURN, follows=True)[0] is Status.LOST


def test_too_few_edges_in_their_places_are_lost(crisp):
    seen = partly(crisp, 0.38, 0.38)
    assert judging(crisp).judge(seen, SPEED, TURN, follows=True)[0] is Status.LOST


def test_where_edges_are_never_crisp_places_tell_nothing(crisp):
    blurred = replace(crisp, sigma_px=0.8)
    seen = partly(blurred, 0.9, 0.3, sigma_px=0.8)
    assert judging(blurred).judge(seen, SPEED, TURN, follows=True)[0] is Status.LOST


# -------------------------------------------------------------------------------- registration


def test_a_known_scale_keeps_edges_out_that_belong_nowhere():
    """Three quarters of the samples lie by up to 25 px beside any edge."""
    worse = 0
    for seed in range(6):
        T = se3.exp(np.array([0.004, -0.003, 0.004, 0.001, 0.002, -0.001]))
        problem = problems.segments_problem(seed, T, outliers=0.75, count=900)
        matching = MatchingConfig(criterion="robust-then-normal")
        registration = Registration(problem.camera, matching, RegistrationConfig())
        index, start = registration.index(problem.reference), np.eye(4)[None]
        free = registration.align(index, problem.samples, start)
        bound = registration.align(index, problem.samples, start, max_sigma_px=0.3)
        assert bound.sigma_px <= 0.3 < free.sigma_px
        off = [problems.error(T, each.T_ref_cur)[0] for each in (free, bound)]
        assert off[1] < 0.002
        worse += off[0] > 2 * off[1]
    assert worse >= 4


# ---------------------------------------------------------------------------------- in a run


@pytest.fixture(scope="module")
def corridor():
    """A corridor whose lamps swing and jump, in its hardest second and a half."""
    source = SyntheticSource(make_recipe("corridor", frames=120, light="ambient+diffuse"))
    frames = [source.read(index).frame for index in range(64, 112)]
    first = se3.inverse(source.ground_truth.at(frames[0].timestamp))
    return source.camera, frames, [first @ source.ground_truth.at(f.timestamp) for f in frames]


def walked(corridor, *overrides):
    camera, frames, truth = corridor
    odometry = Odometry(camera, Config().with_overrides(overrides))
    results = [odometry.track(frame) for frame in frames]
    off = [problems.error(T, r.T_world_cam)[0] for T, r in zip(truth, results, strict=True)]
    return [result.status for result in results], max(off)


def test_a_corridor_whose_lamps_jump_is_followed(corridor):
    statuses, off = walked(corridor)
    assert Status.LOST not in statuses
    assert statuses.count(Status.TRACKED) > 40
    assert off < 0.015


@pytest.mark.parametrize("seed", range(3))
def test_nor_is_it_lost_where_a_keyframe_is_kept_longer(corridor, seed):
    """Half of its edges are then gone at times, and many beside them fit at a wider scale."""
    _, off = walked(corridor, "keyframes.min_overlap=0.6", f"seed={seed}")
    assert off < 0.010


def test_without_the_scale_of_late_it_is_not(corridor):
    # each of these alone mends most of it
    plain = "edges.grey_steps=1", "edges.faint_scale=1", "keyframes.edge_scale=1"
    plain = *plain, "keyframes.gather_share=0", "keyframes.earlier=0", "edges.depth_rule=window"
    plain = *plain, "planes.lead=none"
    statuses, off = walked(corridor, LEFT, *plain)
    assert Status.LOST in statuses
    assert off > 0.05


@pytest.mark.parametrize("size", [0.8, 1.6])
@pytest.mark.parametrize("noise", [1.5, 25])  # grey levels; edges scatter by up to 0.3 px
@pytest.mark.parametrize("overrides", [[], ["planes.weight=0"], NOT_ASKED[:1]])
def test_dense_edges_of_another_place_fit_no_better_than_they_did(size, noise, overrides):
    """By chance up to two thirds of them are where edges are."""
    said = []
    for jump in (2.5, 0):
        # fine as they are: blurred like noise they tell places apart
        changes = *overrides, f"status.edge_jump={jump}", "edges.max_noise=0"
        odometry = Odometry(problems.CAMERA, Config().with_overrides(changes))
        for k in range(14):
            frame = dense(k // 12, size)
            rough = frame.grey + np.random.default_rng(k).normal(0, noise, frame.grey.shape)
            grey = np.clip(rough, 0, 255).astype(np.uint8)
            result = odometry.track(replace(frame, timestamp=k / 30, grey=grey))
            said.append(result.status)
        assert result.alignment.agreeing < 0.3 * len(result.alignment.matches)
    assert said[:14] == said[14:]


def test_a_few_inliers_are_lost_whatever_else_is_not_asked(crisp):
    seen = partly(crisp, 0.02, 0.02)
    judge = judging(crisp, *NOT_ASKED)
    assert judge.judge(seen, SPEED, TURN, follows=True)[0] is Status.LOST


def test_after_a_rest_motion_is_not_scattered():
    """Images that are all but the same give edges that are all but in the same places."""
    frames, truth = problems.sequence(30)
    odometry = Odometry(problems.CAMERA, Config().with_overrides(["edges.position=pixel"]))
    for k in range(12):
        grey = frames[0].grey.copy()
        grey[0, : k + 1] ^= 1
        odometry.track(replace(frames[0], timestamp=(k - 12) / 30, grey=grey))
    off = [problems.error(truth[i], odometry.track(f).T_world_cam)[0] for i, f in enumerate(frames)]
    assert max(off[:20]) < 0.004


class Aside:
    """A tracker whose next frame is in doubt, and a search that leads elsewhere."""

    def __init__(self, monkeypatch, width_px=1.0, **changes):
        self.frames, self.truth = problems.sequence(30)
        self.odometry = Odometry(problems.CAMERA)
        for frame in self.frames[:8]:
            self.odometry.track(frame)
        self.found: list = []
        self.width_px, self.changes = width_px, changes
        monkeypatch.setattr(self.odometry._search, "around", self.around)

    def around(self, key, T_key_start, seen, alignment):
        T = se3.exp(np.full(6, 0.01)) @ alignment.T_ref_cur
        other = crowded(alignment, 0.9, self.width_px)
        self.found.append(replace(other, T_ref_cur=T, **self.changes))
        return self.found[-1]

    def is_taken(self):
        result = self.odometry.track(self.frames[8])
        assert len(self.found) == 1
        return result.alignment is self.found[0]


@pytest.mark.parametrize(("width_px", "is_taken"), [(0.05, True), (3.0, False)])
def test_a_search_takes_nothing_less_clear(monkeypatch, width_px, is_taken):
    """A frame in doubt is searched for elsewhere: more edges that fit there are not enough."""
    aside = Aside(monkeypatch, width_px)
    monkeypatch.setattr(aside.odometry._judge, "_poor_fit", lambda alignment: "in doubt")
    assert aside.is_taken() == is_taken


def test_a_search_saves_what_would_be_lost_however_clear_that_is(monkeypatch):
    aside = Aside(monkeypatch)
    judge = aside.odometry._judge.judge

    def lost(alignment, *given, **options):
        is_other = any(alignment is each for each in aside.found)
        return judge(alignment, *given, **options) if is_other else (Status.LOST, "a jump")

    monkeypatch.setattr(aside.odometry._judge, "judge", lost)
    assert aside.is_taken()


def test_a_search_takes_what_depth_is_not_off_however_clear_the_other_is(monkeypatch):
    aside = Aside(monkeypatch, sigma_depth=0.4)
    align = aside.odometry._registration.align

    def off_planes(*given, **options):
        return replace(align(*given, **options), sigma_depth=9.0)

    monkeypatch.setattr(aside.odometry._registration, "align", off_planes)
    assert aside.is_taken()


def test_where_depth_leads_does_not_lose_what_edges_held(monkeypatch):
    """A wall that moves along leads away from where most edges fit."""
    aside = Aside(monkeypatch)
    odometry, align = aside.odometry, aside.odometry._registration.align

    def off_planes(*given, **options):
        return replace(align(*given, **options), sigma_depth=3.0)

    def on_planes(seen, term, found, *, far):
        assert not far
        return replace(found, inliers=0, agreeing=0)

    monkeypatch.setattr(odometry._registration, "align", off_planes)
    monkeypatch.setattr(odometry._locator, "_on_planes", on_planes)
    monkeypatch.setattr(odometry._search, "around", lambda key, T, seen, alignment: alignment)
    assert odometry.track(aside.frames[8]).status is Status.DEGRADED


@pytest.mark.parametrize("is_clearer", [True, False])
def test_of_several_starts_the_clearest_is_taken_if_it_is_clearer(crisp, monkeypatch, is_clearer):
    """Not what has most edges within three times the usual."""
    odometry = Aside(monkeypatch).odometry
    seen = odometry._front_end.see(problems.sequence(30)[0][8], 8)
    usual, n = odometry._judge.scatter._usual_px, len(seen.samples)
    start, where_found = np.eye(4), se3.exp(np.full(6, 0.1))

    def result(T, count, share, width_px):
        residuals = np.where(np.arange(count) < share * count, width_px, 8.0)
        few = int(0.7 * count)  # as there is no need of other starts where more fit
        matches = np.zeros(count, np.int32)
        return replace(crisp, T_ref_cur=T, residuals=residuals, matches=matches, inliers=few)

    def align(edges, samples, starts, *given, **options):
        """From where it was found few are in their places, but these are clear."""
        from_found = np.array_equal(starts[0], where_found)
        share, width_px = (0.7, 0.2 * usual) if from_found else (0.8, 2.5 * usual)
        return result(starts[0], len(samples), share, width_px)

    monkeypatch.setattr(odometry._registration, "align", align)
    found = result(where_found, n, *((0.8, 2.5 * usual) if is_clearer else (0.9, 0.2 * usual)))
    best = odometry._locator._sharpest(seen, start[None], odometry._fitter.term, found)
    np.testing.assert_array_equal(best.T_ref_cur, where_found)
    assert (best is not found) == is_clearer


@pytest.mark.parametrize(
    ("fitting", "width", "depth", "lost", "tries"),
    [
        (0.9, 1.0, 1.0, False, 2),
        (0.7, 1.0, 1.0, False, 5),  # too few of its edges fit
        (0.9, 3.0, 1.0, False, 5),  # no sharper there
        (0.9, 1.0, 0.5, False, 5),  # depth fits worse
        (0.9, 1.0, 1.0, True, 5),  # as the next stair may fit
    ],
)
def test_where_nearly_all_edges_fit_no_other_start_is_tried(
    crisp, monkeypatch, fitting, width, depth, lost, tries
):
    odometry = Aside(monkeypatch).odometry
    seen = odometry._front_end.see(problems.sequence(30)[0][8], 8)
    usual, n, counts = odometry._judge.scatter._usual_px, len(seen.samples), []
    points, where_found = len(seen.points.sigma), se3.exp(np.full(6, 0.1))
    found = replace(
        crisp,
        T_ref_cur=where_found,
        inliers=int(fitting * n),
        matches=np.zeros(n, np.int32),
        residuals=np.full(n, 3 * usual),
        plane_points=points,
        sigma_depth=1.0,
    )
    monkeypatch.setattr(odometry._locator.assessor, "is_lost", lambda *given: lost)

    def align(edges, samples, starts, *given, **options):
        """From where it was found as told, from elsewhere as sharp but off the planes."""
        counts.append(len(samples))
        here = np.array_equal(starts[0], where_found)
        return replace(
            crisp,
            T_ref_cur=starts[0],
            residuals=np.full(len(samples), width * usual),
            plane_points=int(points * (depth if here else 0.1)),
            sigma_depth=1.0,
        )

    monkeypatch.setattr(odometry._registration, "align", align)
    starts = np.array([np.eye(4), np.eye(4)])
    best = odometry._locator._sharpest(seen, starts, odometry._fitter.term, found)
    assert counts == [*[len(seen.samples.every(4))] * (tries - 1), n]
    if tries == 2:
        assert best is not found
        np.testing.assert_array_equal(best.T_ref_cur, where_found)


def test_depth_that_is_off_leads_back_to_the_planes(monkeypatch):
    """Where edges alone have led astray, and depth says so."""
    frames, truth = problems.sequence(30)
    odometry = Odometry(problems.CAMERA)
    for frame in frames[:8]:
        odometry.track(frame)
    align, astray = odometry._registration.align, se3.exp([0.0, 0.0, 0.05, 0.0, 0.0, 0.0])

    def leads_astray(*given, **options):
        """The first time."""
        monkeypatch.setattr(odometry._registration, "align", align)
        found = align(*given, **options)
        return replace(
            found,
            T_ref_cur=astray @ found.T_ref_cur,
            residuals=found.residuals + 1,
            sigma_depth=9.0,
        )

    monkeypatch.setattr(odometry._registration, "align", leads_astray)
    monkeypatch.setattr(odometry._search, "around", lambda key, T, seen, alignment: alignment)
    result = odometry.track(frames[8])
    assert result.status is Status.TRACKED
    assert problems.error(truth[8], result.T_world_cam)[0] < 0.003


def test_a_lasting_change_becomes_the_usual(crisp):
    judge = judging(crisp)
    wide = replace(crisp, sigma_px=1.2)
    for _ in range(20):
        assert judge.scatter.is_wide(wide)
        judge.scatter.widen()
    for _ in range(20):
        judge.scatter.widen()
    assert not judge.scatter.is_wide(wide)


def test_without_depth_on_planes_nothing_is_told_from_a_hand(crisp):
    bare = replace(crisp, plane_points=0, plane_inliers=0, plane_area=0.0)
    assert not judging(bare).scatter.is_wide(replace(bare, sigma_px=5.0))
    seen = partly(bare, 0.45, 0.44)
    assert judging(bare).judge(seen, SPEED, TURN, follows=True)[0] is Status.LOST


def test_a_registration_that_failed_is_not_scattered_and_wins_nothing(crisp):
    failed = replace(crisp, sigma_px=5.0, reason=FAILURES[0])
    judge = judging(crisp)
    assert not judge.scatter.is_wide(failed)
    assert judge.scatter.in_place(failed) == 0
