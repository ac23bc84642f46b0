"""The table of frames, from records whose numbers are all different."""

import csv
from typing import Any

import numpy as np

from edvo.odometry import Status
from edvo.registration import Alignment
from edvo.report.results import frames_csv
from edvo.report.tracking import FrameRecord, Registration

FOUND = {
    "iterations": 7,
    "matches": 97,
    "inliers": 90,
    "agreeing": 83,
    "sigma_px": 0.25,
    "plane_points": 400,
    "sigma_depth": 1.5,
    "depth_balance": 0.75,
}


def row(**more: Any) -> dict[str, str]:
    given: dict[str, Any] = {
        "stamp": "1.50",
        "timestamp": 1.5,
        "status": Status.TRACKED,
        "reason": "",
        "T_world_cam": np.eye(4),
        "keyframe": 3,
        "is_keyframe": False,
        "edges": 1000,
        "samples": 100,
        "registration": Registration(**FOUND),
        "track_s": 0.002,
        "stages": {"edges": 0.001},
        "problem": None,
    }
    (found,) = csv.DictReader(frames_csv([FrameRecord(**{**given, **more})]).splitlines())
    return found


def test_numbers_are_those_of_the_alignment() -> None:
    others = dict.fromkeys(Alignment.__slots__)
    matches = np.where(np.arange(100) < 3, -1, 0).astype(np.int32)
    found = Alignment(**{**others, **FOUND, "matches": matches})  # type: ignore[arg-type]
    assert Registration.of(found) == Registration(**FOUND)


def test_numbers_of_a_registration_are_in_their_columns() -> None:
    assert {name: float(row()[name]) for name in FOUND} == FOUND


def test_the_piece_of_the_path() -> None:
    assert (row()["piece"], row(piece=2)["piece"]) == ("0", "2")


def test_agreeing_stands_behind_inliers() -> None:
    names = list(row())
    assert names[names.index("inliers") + 1] == "agreeing"


def test_without_a_registration_its_columns_are_empty() -> None:
    frame = row(registration=None, status=Status.LOST, reason="dark")
    assert {frame[name] for name in FOUND} == {""}
    assert (frame["status"], frame["reason"]) == ("lost", "dark")


def test_without_planes_there_is_no_scale_of_theirs() -> None:
    without = row(registration=Registration(**{**FOUND, "plane_points": 0}))
    assert (without["plane_points"], without["sigma_depth"]) == ("0", "")
