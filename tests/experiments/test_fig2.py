"""Edges that are found again."""

import cv2
import numpy as np
import pytest

from edvo import se3
from edvo.camera import Camera
from edvo.config import Config
from edvo.experiments import fig2
from edvo.experiments.bench import Bench
from edvo.frame import Frame

LINE = np.zeros((60, 80), bool)
LINE[10:50, 30] = True


def test_the_same_edges_are_all_found() -> None:
    same = fig2.recurrence(LINE, LINE)
    assert same.found == (1.0, 1.0)
    assert same.count_ratio == 1.0
    assert same.edges == 40 / 4800
    assert same.beyond_chance == 1.0


@pytest.mark.parametrize(("shift", "found"), [(1, (1.0, 1.0)), (2, (0.0, 1.0)), (3, (0.0, 0.0))])
def test_radius(shift: int, found: tuple[float, float]) -> None:
    assert fig2.recurrence(LINE, np.roll(LINE, shift, axis=1)).found == found


def test_chance_is_what_any_pixel_scores() -> None:
    rng = np.random.default_rng(0)
    anywhere, thick = rng.random((200, 200)) < 0.1, rng.random((200, 200)) < 0.1
    found = fig2.recurrence(anywhere, thick)
    assert found.found[0] > 0.5
    assert abs(found.beyond_chance) < 0.03


def test_nothing_to_find() -> None:
    nothing = np.zeros_like(LINE)
    assert fig2.recurrence(LINE, nothing).found == (0.0, 0.0)
    assert fig2.recurrence(nothing, LINE).same_count == 0.0


def test_warp_moves_a_plane_by_what_geometry_says() -> None:
    camera = Camera(80, 60, 100.0, 100.0, 39.5, 29.5)
    depth = np.full((60, 80), 2.0, np.float32)
    frame = Frame(0.0, np.zeros((60, 80), np.uint8), depth)
    # The camera moves 0.1 m to the right: everything moves 5 pixels to the left.
    T_world_later = np.eye(4)
    T_world_later[0, 3] = 0.1
    T_later_first = se3.inverse(T_world_later)
    config = Config.preset("paper").edges
    index = np.flatnonzero(LINE)
    pixels = fig2.warp(index, frame, frame, T_later_first, camera, config)
    assert set(map(tuple, pixels.tolist())) == {(25, v) for v in range(10, 50)}
    hidden = Frame(0.0, frame.grey, np.full((60, 80), 1.0, np.float32))
    assert len(fig2.warp(index, frame, hidden, T_later_first, camera, config)) == 0
    T_later_first[0, 3] = -10.0
    assert len(fig2.warp(index, frame, frame, T_later_first, camera, config)) == 0


def test_equally_many_edges() -> None:
    rng = np.random.default_rng(1)
    noise = cv2.GaussianBlur(rng.integers(0, 255, (120, 160), np.uint8), (0, 0), 3)
    image = cv2.normalize(noise, None, 0, 255, cv2.NORM_MINMAX)
    configs = fig2.calibrated([image])
    counts = {name: fig2.edge_mask(image, configs[name]).sum() for name in fig2.EXTRACTORS}
    assert counts["canny"] > 100
    for name in ("sobel", "dog"):
        assert counts[name] == pytest.approx(counts["canny"], rel=0.15)  # levels are whole


def test_those_with_the_presets_threshold_are_shown_and_not_ranked() -> None:
    shares = {"sobel": 0.3, "dog": 0.4, "canny": 0.5, "sobel-preset": 0.9, "dog-preset": 0.8}
    results = {
        ("a", extractor, condition): fig2.Recurrence(0.1, share, (share, 1.0), (0.0, 0.0))
        for extractor, share in shares.items()
        for condition in fig2.CONDITIONS
    }
    for found in (
        fig2._most_recurring(results, fig2.CONDITIONS, "always"),
        fig2._steadiest(results),
    ):
        assert found.holds is True
        assert "preset threshold" in found.sentence


def test_in_a_small_setting(bench: Bench) -> None:
    outcome = fig2.EXPERIMENT.run(bench)
    records = outcome.tables[0].records
    assert len(records) == 2 * len(fig2.CONDITIONS) * 5
    for record in records:
        assert 0 <= record["found_1px"] <= record["found_2px"] <= 1
        assert 0 <= record["chance_1px"] <= record["chance_2px"] <= 1
    of = {(r["sequence"], r["extractor"], r["condition"]): r for r in records}
    for name in fig2._QUICK:
        # The view changes little in 0.2 s; more light is lost at the hardest.
        assert of[name, "canny", fig2.WARPED]["found_2px"] > 0.6
        relit, harder = (of[name, "canny", kind] for kind in (fig2.RELIT, fig2.HARDER))
        assert relit["found_1px"] >= harder["found_1px"]
    assert len(outcome.figures) == 3
    assert all(figure.png.startswith(b"\x89PNG") for figure in outcome.figures)
    assert [finding.holds is not None for finding in outcome.findings] == [True] * 3
