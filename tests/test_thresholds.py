"""How far Canny's thresholds sink, and which edges a keyframe keeps."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from edvo import front_end, kernels
from edvo.config import Config, EdgesConfig
from edvo.detail import Detail
from edvo.edges import EdgeBuffers, edges_to_keep, extract_edges
from edvo.odometry import Odometry, Status
from edvo.synthesis.sequence import SyntheticSource, make_recipe
from edvo.thresholds import STEP_PX, exceeded, undercut

from . import problems, twins
from .test_kernels import both

SHAPE = (240, 320)
HIGH = EdgesConfig().high


def noisy(sigma, contrast=0.0, seed=0):
    """Noise of so many grey levels, and a disc that is so much brighter."""
    rng = np.random.default_rng(seed)
    v, u = np.mgrid[: SHAPE[0], : SHAPE[1]]
    disc = contrast / (1 + np.exp(np.hypot(u - 160, v - 120) - 70.0))
    return (120 + disc + rng.normal(0, sigma, SHAPE)).round().astype(np.uint8)


def scale_of(grey, *, faint, **changes):
    scales = extract_edges(grey, EdgesConfig(**changes)).scales
    return scales.faint if faint else scales.usual


def indices(grey, **changes):
    return extract_edges(grey, EdgesConfig(**changes)).index


def test_strengths_are_counted_as_by_numpy():
    rng = np.random.default_rng(5)
    du, dv = rng.normal(0, 60, (2, 50, 66)).astype(np.int16)
    half = STEP_PX // 2

    def counted():
        counts = np.arange(200, dtype=np.int32)  # what is there is added to
        kernels.count_strengths(du, dv, STEP_PX, counts)
        return counts

    def twin():
        strength = np.abs(du[half::STEP_PX, half::STEP_PX].astype(int))
        strength += np.abs(dv[half::STEP_PX, half::STEP_PX])
        return np.arange(200) + np.bincount(np.minimum(strength.ravel(), 199), minlength=200)

    np.testing.assert_array_equal(*both("count_strengths", counted, twin))


@settings(deadline=None)
@given(
    strengths=st.lists(st.integers(0, 30), min_size=1, max_size=200),
    share=st.floats(0.01, 0.99),
)
def test_quantiles_are_those_of_sorted_strengths(strengths, share):
    counts = np.bincount(strengths, minlength=31).astype(np.int32)
    strengths = np.array(strengths)
    value = exceeded(counts, share)
    assert value == twins.exceeded(counts, share)
    assert undercut(counts, share) == twins.undercut(counts, share)
    assert (strengths > value).sum() <= share * len(strengths)
    assert value == 0 or (strengths >= value).sum() > share * len(strengths)
    some = strengths[strengths > 0]
    below = undercut(counts, share)
    if not len(some):
        assert below == 0
        return
    assert (some < below).sum() < share * len(some)
    assert (some < below + 1).sum() >= share * len(some)


def test_thresholds_follow_the_image_within_bounds():
    grey = problems.drawn_image(np.random.default_rng(0))
    faint = (100 + 0.04 * (grey.astype(float) - 100)).round().astype(np.uint8)
    noise = np.random.default_rng(1).integers(0, 256, grey.shape).astype(np.uint8)
    fixed, half = {"strong_share": 0}, {"strong_share": 0, "low": 11, "high": 22}
    np.testing.assert_array_equal(indices(faint), indices(faint, **half))
    assert len(indices(faint)) > len(indices(faint, **fixed))
    np.testing.assert_array_equal(indices(noise), indices(noise, **fixed))
    np.testing.assert_array_equal(indices(faint, least_scale=1), indices(faint, **fixed))
    assert scale_of(faint, faint=True, strong_share=0) == 1


def test_they_sink_farther_as_noise_allows():
    """A quarter of the gradients of white noise stay below 0.954 of their own sigma."""
    blur, slope = np.array([1, 4, 6, 4, 1]) / 16, np.array([-1, 0, 1])
    along, across = np.convolve(blur, slope), np.convolve(blur, [1, 2, 1])
    gain = np.sqrt((along**2).sum() * (across**2).sum())  # 1.09
    margin = EdgesConfig().noise_margin
    for sigma in (1.5, 2.0, 2.4):  # as noisy as an image may be, or nearly
        floor = margin * 0.954 * gain * np.hypot(sigma, 12**-0.5) / HIGH
        assert 0.3 < floor < 0.55
        found = scale_of(noisy(sigma), faint=True, max_noise=0)
        assert found == pytest.approx(floor, rel=0.08)
        assert scale_of(noisy(sigma), faint=False) == 0.55
    assert scale_of(noisy(0.5), faint=True) == 0.3
    assert scale_of(noisy(0.5), faint=True, faint_scale=0.4) == 0.4
    assert scale_of(noisy(0.5), faint=True, faint_scale=1) == 0.55
    assert scale_of(noisy(6.0), faint=True, max_noise=0) == 0.55
    assert scale_of(np.full(SHAPE, 7, np.uint8), faint=True) == 0.3


@pytest.mark.parametrize("sigma", [0.3, 1.0, 2.0, 3.0, 6.0, 12.0, 25.0])
def test_noise_is_no_edge(sigma):
    assert len(extract_edges(noisy(sigma), EdgesConfig(), faint=True)) <= 20  # of 76,800 pixels


@pytest.mark.parametrize("sigma", [0.3, 1.0, 1.5])
def test_a_faint_contour_is_one(sigma):
    usual, faint = (
        extract_edges(noisy(sigma, contrast=7.0), EdgesConfig(), faint=faint)
        for faint in (False, True)
    )
    v, u = np.divmod(faint.index, SHAPE[1])
    on = np.abs(np.hypot(u - 160, v - 120) - 70) < 4
    assert np.count_nonzero(on) > 300
    assert np.count_nonzero(~on) <= 20
    assert len(usual) < np.count_nonzero(on) / 2


def test_what_is_black_does_not_pass_for_quiet():
    grey = noisy(2.0)
    grey[:, :200] = 0
    assert scale_of(grey, faint=True) == pytest.approx(scale_of(noisy(2.0), faint=True), rel=0.15)


@pytest.mark.parametrize("faint", [False, True])
@pytest.mark.parametrize("share", [1.0, 0.8, 0.4])
@pytest.mark.parametrize(("sigma", "contrast"), [(1.5, 25.0), (3.0, 9.0), (0.5, 3.0)])
def test_a_keyframe_keeps_the_edges_of_both_thresholds(faint, share, sigma, contrast):
    grey, config = noisy(sigma, contrast), EdgesConfig()
    buffers = EdgeBuffers(*SHAPE)
    image = extract_edges(grey, config, buffers, faint=faint)
    kept, telling = edges_to_keep(image, config, buffers, share)
    assert kept.scale == share * scale_of(grey, faint=True)
    expected = extract_edges(grey, config, scale=kept.scale).index
    np.testing.assert_array_equal(np.sort(kept.index), expected)
    np.testing.assert_array_equal(kept.index[:telling], extract_edges(grey, config).index)
    assert (np.diff(kept.index[telling:]) > 0).all()


def test_strong_edges_are_those_of_canny_on_any_gradients():
    """Snakes that only weak pixels hold together, of random gradients."""
    rng = np.random.default_rng(7)
    for _ in range(40):
        du, dv = rng.integers(-60, 61, (2, 37, 53)).astype(np.int16)
        marks, room = np.zeros(du.shape, np.uint8), np.empty(2 * du.size + 1, np.int32)
        found = []
        for low, high in ((35, 90), (10, 50)):
            kernels.canny_edges(du, dv, np.int32(low), np.int32(high), marks, room)
            found.append(np.flatnonzero(marks).astype(np.int32))
        strong, every = found
        order, given = np.empty_like(every), (every, du, dv, np.int32(35), np.int32(90))

        def apart(given=given, marks=marks, room=room, order=order):
            count = kernels.put_strong_first(*given, marks, room, order)
            return order[:count], order[count:]

        def twin(strong=strong, every=every):
            return strong, np.setdiff1d(every, strong)

        for kernel, expected in zip(*both("put_strong_first", apart, twin), strict=True):
            np.testing.assert_array_equal(kernel, expected)
        assert 50 < len(strong) < len(every)


def test_of_other_extractors_and_the_paper_it_keeps_the_same():
    grey, buffers = noisy(1.5, contrast=25.0), EdgeBuffers(*SHAPE)
    fixed = EdgesConfig(strong_share=0)
    for config in (EdgesConfig(extractor="sobel"), Config.preset("paper").edges, fixed):
        image = extract_edges(grey, config, buffers)
        share = Config().keyframes.edge_scale
        kept, telling = edges_to_keep(image, config, buffers, share)
        assert kept is image
        assert telling == len(image)


@pytest.fixture(scope="module")
def plain():
    source = SyntheticSource(make_recipe("notexture_far", frames=40, seed=5))
    return source, [source.read(index).frame for index in range(40)]


def test_frames_that_follow_closely_show_faint_edges(plain):
    source, frames = plain
    odometry = Odometry(source.camera)
    results = [odometry.track(frame) for frame in frames]
    key = odometry._course.keyframe
    assert key.is_faint
    assert len(key.edges) > 1.2 * len(key.telling)
    ahead = len(key.telling)
    np.testing.assert_array_equal(key.edges.edges.pixels[:ahead], key.telling.edges.pixels)
    assert results[0].edge_scale == 0.55
    assert all(0.3 <= result.edge_scale < 0.55 for result in results[1:])
    for frame, result in zip(frames, results, strict=True):
        found = extract_edges(frame.grey, odometry.config.edges, scale=result.edge_scale)
        assert len(found) == result.edges


def test_a_far_step_is_told_by_those_that_are_not_faint(plain, monkeypatch):
    source, frames = plain
    odometry = Odometry(source.camera)
    odometry.track(frames[0])
    registered, align = [], odometry._registration.align

    def spied(reference, *given, **named):
        registered.append(reference)
        return align(reference, *given, **named)

    monkeypatch.setattr(odometry._registration, "align", spied)
    odometry.track(frames[1])
    assert odometry._course.keyframe.edges in registered
    registered.clear()
    far = odometry.track(frames[39])
    assert far.edge_scale == 0.55
    assert registered
    assert odometry._course.keyframe.edges not in registered


def test_it_can_be_left_out(plain):
    source, frames = plain
    off = ["edges.faint_scale=1", "keyframes.edge_scale=1"]
    odometry = Odometry(source.camera, Config().with_overrides(off))
    results = [odometry.track(frame) for frame in frames[:5]]
    assert {result.edge_scale for result in results} == {0.55}
    key = odometry._course.keyframe
    assert not key.is_faint
    assert key.edges is key.telling


def positions(edges):
    return {tuple(pixel) for pixel in edges.pixels.round(2).tolist()}


def test_the_samples_of_a_keyframe_tell_places(plain):
    source, frames = plain
    config = Config().with_overrides(["keyframes.max_translation_m=0.01"])
    odometry = Odometry(source.camera, config)
    results = [odometry.track(frame) for frame in frames[:30]]
    key = odometry._course.keyframe
    assert key.index > 0
    assert results[key.index].edge_scale < 0.55
    assert len(key.samples) > 300
    assert positions(key.samples) <= positions(key.telling.edges)


def test_samples_drawn_anew_are_moved_for_their_rows(plain, monkeypatch):
    source, frames = plain
    odometry = Odometry(source.camera)
    odometry.track(frames[0])
    seen = odometry._front_end.see(frames[1], 1, None, near_and_faint())
    moved = np.float32(32.0)

    def unrolled(edges, velocity, depths=None):
        return replace(edges, pixels=edges.pixels + moved)

    monkeypatch.setattr(odometry._instants.rolling, "unrolled", unrolled)
    key = odometry._upkeep.make(seen.kept(), 1, np.full(6, 0.1))
    there = np.round(key.samples.pixels - moved, 2).tolist()
    known = positions(key.telling.edges)  # not moved: no readout is known
    assert np.mean([tuple(pixel) in known for pixel in there]) > 0.9


def near_and_faint():
    return Detail(1500, is_fine=False, is_near=True, is_faint=True)


def test_where_only_faint_edges_are_left_one_dropped_frame_is_no_end(plain):
    """Without depth alone to fall back on for good: faint edges are looked for again."""
    source, frames = plain
    odometry = Odometry(source.camera)
    results = []
    for k, frame in enumerate(frames):
        contrast = max(1 - 0.091 * k, 0.09)
        grey = (128 + contrast * (frame.grey.astype(float) - 128)).round().astype(np.uint8)
        if k == 20:
            results.append(odometry.skip(frame.timestamp, "dropped"))
        else:
            results.append(odometry.track(replace(frame, grey=grey)))
    assert {result.status for result in results[:20]} == {Status.TRACKED}
    assert {result.edge_scale for result in results[12:20]} == {0.3}
    assert results[21].edge_scale == 0.55
    assert {result.status for result in results[24:]} == {Status.TRACKED}


def test_a_keyframe_moved_for_its_rows_keeps_them_apart(plain):
    source, frames = plain
    odometry = Odometry(source.camera)
    for frame in frames[:3]:
        odometry.track(frame)
    key, instants = odometry._course.keyframe, odometry._instants
    instants._held.known = None
    instants.rolling.estimate = type("Told", (), {"value": 0.02})()
    changed = instants.renewed(key, np.array([0.5, 0.0, 0.0, 0.0, 0.5, 0.0]))
    assert changed is not None
    telling = len(key.telling)
    assert len(changed.telling) == telling < len(changed.edges) == len(key.edges)
    np.testing.assert_array_equal(
        changed.edges.edges.pixels[:telling], changed.telling.edges.pixels
    )
    assert np.abs(changed.edges.edges.pixels - key.edges.edges.pixels).max() > 0.5


def test_no_more_edges_are_looked_at_than_may_be_gathered(plain, monkeypatch):
    source, frames = plain
    odometry = Odometry(source.camera)
    seen = odometry._front_end.see(frames[0], 0)
    every = len(odometry._front_end.edges_with_depth(seen))
    monkeypatch.setattr(front_end, "GATHERED", 50)
    assert len(odometry._front_end.edges_with_depth(seen)) == 50 < every
