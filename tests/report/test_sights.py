"""What is drawn of a frame lies where the picture shows it."""

import csv
import io

import cv2
import numpy as np
import pytest

from edvo.camera import Camera
from edvo.config import Config
from edvo.datasets.source import Reading
from edvo.frame import Frame
from edvo.odometry import Odometry
from edvo.report.results import frames_csv
from edvo.report.run_film import caption, film_frame
from edvo.report.sights import Sight, look_again
from edvo.report.tracking import track_reading


@pytest.mark.parametrize("distortion", [(0.0,) * 5, (-0.3, 0.1, 0.0, 0.0, 0.0)])
def test_edges_and_matches_lie_on_the_picture(
    distortion: tuple[float, float, float, float, float],
) -> None:
    camera = Camera(
        width=320, height=240, fx=260.0, fy=260.0, cx=159.5, cy=119.5, distortion=distortion
    )
    rng = np.random.default_rng(1)
    grey = np.full((240, 320), 120, np.uint8)
    for u, v, width, height, value in rng.integers(
        (0, 0, 20, 20, 0), (300, 220, 80, 80, 255), (40, 5)
    ):
        grey[v : v + height, u : u + width] = value
    grey = np.asarray(cv2.GaussianBlur(grey, (3, 3), 0), np.uint8)
    frame = Frame(0.0, grey, np.full((240, 320), 2.0, np.float32))
    odometry = Odometry(camera)
    odometry.track(frame)
    grey = grey + rng.integers(0, 2, grey.shape, np.uint8)  # or it would be a frozen stream
    again = Frame(1 / 30, grey, frame.depth)
    sight = Sight(again, odometry.track(again))
    seen = look_again(sight, camera, Config())
    du, dv = (cv2.Sobel(seen.grey, cv2.CV_32F, *order) for order in ((1, 0), (0, 1)))
    strength = np.abs(du) + np.abs(dv)
    inside = ((seen.pixels > 3) & (seen.pixels < (316, 236))).all(axis=1)
    columns, rows = np.rint(seen.pixels[inside]).astype(int).T
    assert np.median(strength[rows, columns]) > 3 * strength.mean()
    # The same frame again: samples match where they are.
    assert len(seen.samples) > 100
    assert np.median(np.linalg.norm(seen.samples - seen.references, axis=1)) < 0.5
    image = cv2.imdecode(np.frombuffer(film_frame(sight, camera, Config()), np.uint8), 1)
    assert image is not None
    assert image.shape == (390, 2 * 520 + 8, 3)
    assert "frame 1, 0.03 s: tracked" in caption(sight, 0.0)


def test_a_frame_without_edges_is_shown_by_what_it_has() -> None:
    camera = Camera(width=320, height=240, fx=260.0, fy=260.0, cx=159.5, cy=119.5)
    rng = np.random.default_rng(1)
    squares = np.kron(rng.integers(0, 255, (12, 16)), np.ones((20, 20))).astype(np.uint8)
    odometry, records, frames = Odometry(camera), [], []
    for index, grey in enumerate((squares, np.full_like(squares, 5))):
        depth = (2.0 + rng.normal(0, 0.002, grey.shape)).astype(np.float32)
        frames.append(Frame(index / 30, grey, depth))
        reading = Reading(index, str(index), index / 30, frames[-1], None)
        records.append(track_reading(odometry, reading, None))
    row = list(csv.DictReader(io.StringIO(frames_csv(records))))[1]
    assert row["status"] == "degraded"
    assert [row[key] for key in ("samples", "matches", "inliers")] == ["0"] * 3
    assert row["sigma_px"] == ""
    assert int(row["plane_points"]) > 100
    assert 0.3 < float(row["sigma_depth"]) < 1
    again = Odometry(camera)
    again.track(frames[0])
    sight = Sight(frames[1], again.track(frames[1]))
    assert not len(look_again(sight, camera, Config()).samples)
    assert cv2.imdecode(np.frombuffer(film_frame(sight, camera, Config()), np.uint8), 1) is not None
    assert f"{row['plane_points']} points on planes of keyframe 0" in caption(sight, 0.0)
