"""How smeared images are, and that those that are smeared otherwise are seen alike."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from edvo import kernels, se3
from edvo.camera import Camera
from edvo.config import Config, EdgesConfig
from edvo.edges import extract_edges
from edvo.exposure import sharp_variance
from edvo.frame import Frame
from edvo.front_end import FEW
from edvo.odometry import Odometry, Status
from edvo.smear import ENOUGH, Smear, edge_variance
from edvo.synthesis.sequence import SyntheticSource, make_recipe

from . import problems

CONFIG = EdgesConfig(smear="measured")
WHATEVER = ("edges.smear=measured", "motion.exposure=none")  # whatever has smeared them
MEASURED = Config().with_overrides(WHATEVER)
CAMERA = Camera(width=320, height=240, fx=260, fy=260, cx=159.5, cy=119.5)


def bars(sigma, noise=1.0, contrast=80.0):
    """Discs and bars, out of focus by so many pixels."""
    fine = np.full((960, 1280), 90.0, np.float32)
    for k in range(8):
        cv2.circle(fine, (90 + 155 * k, 150 + 60 * (k % 3)), 55, 90 + contrast, -1)
        cv2.line(fine, (60 + 155 * k, 950), (110 + 155 * k, 420), 90 - 0.7 * contrast, 60)
    if sigma:
        fine = cv2.GaussianBlur(fine, (0, 0), 4 * sigma)
    coarse = cv2.resize(fine, (320, 240), interpolation=cv2.INTER_AREA)
    coarse += np.random.default_rng(1).normal(0, noise, coarse.shape)
    return coarse.round().clip(0, 255).astype(np.uint8)


def profiles(grey, passes=0, config=CONFIG):
    edges = extract_edges(grey, config, passes=passes)
    return edges, edges.describe(CAMERA).profiles


def noted(smear, grey, at):
    """Show an image, blurred by as much as is called for."""
    smear.note(*profiles(grey, smear.passes), at)
    return smear.passes


@pytest.mark.parametrize(("size", "variance"), [(0, 0.0), (3, 0.5), (5, 1.0), (9, 2.7)])
def test_the_width_of_a_sharp_edge(size, variance):
    assert sharp_variance(size) - sharp_variance(0) == pytest.approx(variance, rel=0.1)


@pytest.mark.parametrize("sigma", [0.0, 0.7, 1.0, 1.5, 2.0])
@pytest.mark.parametrize("passes", [0, 1, 2])
def test_edges_are_as_wide_as_what_blurred_them(sigma, passes):
    _, found = profiles(bars(sigma), passes)
    blurred = sharp_variance(CONFIG.blur_px) + 2 * passes + 0.4 * (passes > 0)
    assert edge_variance(found) == pytest.approx(blurred + sigma**2, rel=0.15)


def test_noise_that_widens_faint_edges_is_no_smear():
    grey = bars(0.0, noise=2.4)
    grey[:120] = bars(0.0, noise=2.4, contrast=9.0)[:120]
    edges = extract_edges(grey, CONFIG, faint=True)
    smear = Smear(CONFIG)
    smear.note(edges, edges.describe(CAMERA).profiles, 0.0)
    assert smear.settle() == 0


def test_what_is_blurred_for_its_noise_is_not_smeared():
    grey = bars(0.0, noise=9.0)
    edges, found = profiles(grey)
    assert edges.blur_px2 > 2
    smear = Smear(CONFIG)
    smear.note(edges, found, 0.0)
    assert smear.settle() == 0


@pytest.mark.parametrize(("sigma", "passes"), [(0.0, 0), (0.6, 0), (0.95, 1), (1.3, 2), (2.2, 4)])
def test_the_more_images_are_smeared_the_more_they_are_blurred(sigma, passes):
    smear = Smear(CONFIG)
    noted(smear, bars(sigma), 0.0)
    assert smear.settle() == passes
    for k in range(1, 30):  # and what they are blurred by changes nothing of that
        noted(smear, bars(sigma), k / 30)
        assert smear.settle() == passes


def test_a_little_less_lets_it_go_on():
    smear = Smear(CONFIG)
    noted(smear, bars(0.5), 0.0)
    assert smear.settle() == 0
    noted(smear, bars(1.0), 10.0)
    assert smear.settle() == 1
    noted(smear, bars(0.5), 20.0)
    assert smear.settle() == 1
    noted(smear, bars(0.0), 30.0)
    assert smear.settle() == 0


def test_images_stay_like_their_keyframe_unless_they_are_far_off():
    smear = Smear(CONFIG)
    noted(smear, bars(0.0), 0.0)
    smear.settle()
    assert noted(smear, bars(0.95), 10.0) == 0
    assert noted(smear, bars(2.2), 20.0) == 4
    assert noted(smear, bars(0.0), 30.0) == 4
    assert smear.settle() < 4


def test_it_is_a_mean_of_late():
    smear = Smear(CONFIG)
    for k in range(10):
        noted(smear, bars(0.0), k / 30)
    noted(smear, bars(1.3), 10 / 30)
    assert smear.settle() == 0  # one image alone
    for k in range(11, 30):
        noted(smear, bars(1.3), k / 30)
    assert smear.settle() == 2
    smear.forget()
    assert smear.settle() == 0


def test_few_edges_tell_nothing():
    smear = Smear(CONFIG)
    edges, found = profiles(bars(2.2))
    smear.note(edges, found[: ENOUGH - 1], 0.0)
    assert smear.settle() == 0
    smear.note(edges, found[:ENOUGH], 0.0)
    assert smear.settle() > 0


def test_nothing_is_measured_of_others_edges_or_where_it_is_not_wanted():
    others = [EdgesConfig(smear="measured", extractor=name) for name in ("dog", "sobel")]
    at_pixels = EdgesConfig(smear="measured", position="pixel")
    for config in (EdgesConfig(), Config.preset("paper").edges, at_pixels, *others):
        smear = Smear(config)
        smear.note(*profiles(bars(2.2), config=config), 0.0)
        assert smear.settle() == 0


@pytest.mark.parametrize("blur_px", [0, 3, 9])
def test_a_blur_of_another_size_is_taken_off(blur_px):
    config = EdgesConfig(smear="measured", blur_px=blur_px)
    for sigma, passes in ((0.0, 0), (1.3, 2)):
        smear = Smear(config)
        smear.note(*profiles(bars(sigma), config=config), 0.0)
        assert smear.settle() == passes


def test_nothing_is_left_to_be_compiled_when_images_are_smeared(monkeypatch):
    kernel = kernels.widely_blurred_gradients
    writeable = problems.watched_by_warm_up(monkeypatch, "widely_blurred_gradients")
    before = len(kernel.signatures)
    grey = bars(1.0)
    for image in (grey, Frame(0.0, grey, np.ones(grey.shape, np.float32)).grey):
        profiles(image, passes=1)
    assert len(kernel.signatures) == before
    assert not any(writeable["widely_blurred_gradients"])


def still(grey):
    return Frame(0.0, grey, np.full(grey.shape, 2.0, np.float32))


@pytest.mark.parametrize("sigma", [1.2, 1.4])
def test_what_shows_hardly_any_edges_is_blurred_as_usual(sigma):
    odometry = Odometry(CAMERA, MEASURED)
    grey = bars(sigma, noise=0.5, contrast=10.0)
    shown = len(extract_edges(grey, CONFIG))
    blurred = len(extract_edges(grey, CONFIG, passes=4))
    assert blurred < FEW < shown
    odometry.track(still(grey))
    assert len(odometry._course.key.telling) == shown


def test_a_camera_that_comes_to_faint_edges_is_not_lost_for_its_blur():
    odometry = Odometry(CAMERA, MEASURED)
    images = [bars(2.2)] * 3 + [bars(0.0, noise=0.5, contrast=12.0)] * 4
    results = []
    for k, grey in enumerate(images):
        spoiled = np.clip(grey.astype(int) + k, 0, 255).astype(np.uint8)  # else it is a freeze
        results.append(odometry.track(replace(still(spoiled), timestamp=k / 30)))
    assert results[2].edge_passes > 0
    assert [r.edge_passes for r in results[3:]] == [0] * 4
    assert min(r.edges for r in results[3:]) > 1000


def test_a_still_image_of_texture_is_blurred_alike_from_frame_to_frame():
    rng = np.random.default_rng(3)
    texture = cv2.GaussianBlur(rng.normal(size=(240, 320)).astype(np.float32), (0, 0), 2.0)
    grey = (128 + 40 * texture / texture.std()).clip(0, 255).astype(np.uint8)
    smear = Smear(CONFIG)
    noted(smear, grey, 0.0)
    smear.settle()
    assert len({noted(smear, grey, k / 30) for k in range(60)}) == 1


@pytest.fixture(scope="module")
def shaken():
    """Panels before a camera that is shaken: each image is smeared in another direction."""
    recipe = make_recipe("notexture_far", frames=40, camera=problems.CAMERA, seed=3)
    source = SyntheticSource(recipe)
    frames = [source.read(index).frame for index in range(40)]
    return source, [replace(f, grey=smeared(f.grey, 60 + 40 * k)) for k, f in enumerate(frames)]


def smeared(grey, degrees, length=9):
    kernel = np.zeros((length, length), np.float32)
    way = (length // 2) * np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees))])
    start, end = (np.round(length // 2 + sign * way).astype(int).tolist() for sign in (-1, 1))
    cv2.line(kernel, start, end, 1.0)
    return cv2.filter2D(grey, -1, kernel / kernel.sum())


def follow(shaken, *overrides):
    source, frames = shaken
    odometry = Odometry(source.camera, Config().with_overrides(overrides))
    results = [odometry.track(frame) for frame in frames]
    start = se3.inverse(source.ground_truth.at(frames[0].timestamp))
    first = se3.inverse(results[0].T_world_cam)
    errors = [
        problems.error(first @ r.T_world_cam, start @ source.ground_truth.at(r.timestamp))[0]
        for r in results
    ]
    return results, max(errors)


def test_a_camera_whose_images_are_smeared_is_followed_without_doubt(shaken):
    results, error = follow(shaken, *WHATEVER)
    assert all(result.status is Status.TRACKED for result in results)
    assert min(result.edge_passes for result in results[1:]) > 0
    assert error < 0.005


def test_as_it_is_such_a_camera_is_in_doubt(shaken):
    results, _ = follow(shaken)
    assert {result.edge_passes for result in results} == {0}
    assert sum(result.status is not Status.TRACKED for result in results) > 10


def test_the_first_keyframe_is_blurred_as_those_after_it(shaken):
    source, frames = shaken
    odometry = Odometry(source.camera, MEASURED)
    odometry.track(frames[0])
    key = odometry._course.key
    passes = odometry._front_end._smear.passes
    assert passes > 0
    # its edges are those of the blurred image
    wanted = extract_edges(frames[0].grey, odometry.config.edges, passes=passes)
    usual = extract_edges(frames[0].grey, odometry.config.edges)
    assert len(key.telling) == len(wanted) != len(usual)
    assert odometry.track(frames[1]).edge_passes == passes
    odometry.reset()
    assert odometry._front_end._smear.passes == 0
