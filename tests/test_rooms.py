"""Rooms that benchmarks draw by a seed, and what is made of them."""

from dataclasses import replace

import numpy as np
import pytest
from benchmarks import rooms
from benchmarks.room_drawing import Room, draw
from benchmarks.room_things import APART_M, KINDS

from edvo import se3
from edvo.odometry import Status, TrackedFrame
from edvo.synthesis.motion import ClosedSpline

SEEDS = 40  # that are looked at
INSTANTS = np.linspace(0, 4, 9)  # s
HAND_M = 0.1  # by so much a hand leaves the way


@pytest.fixture(scope="module")
def drawn() -> list[Room]:
    return [draw(seed) for seed in range(SEEDS)]


def places(room: Room) -> np.ndarray:
    """Where the camera is, (N, 3)."""
    motion = room.recipe(rooms.FRAMES).motion
    return np.array([motion.at(float(t))[:3, 3] for t in INSTANTS])


def test_a_seed_gives_the_same_room_and_another_seed_another_one(drawn):
    assert draw(3) == drawn[3]
    assert len({room.plan for room in drawn}) == len(drawn)
    assert {room.plan.kind for room in drawn} == set(KINDS)


def test_seeds_give_what_they_gave(drawn):
    assert [room.plan.kind for room in drawn[:5]] == ["desk", "turn", "wall", "walk", "turn"]
    assert [room.people for room in drawn[14:20]] == [1, 2, 1, 2, 2, 2]
    last = drawn[39].filming  # whatever is drawn before counts, too
    assert (last.sensor, last.camera.width) == ("realsense_d415", 320)


def test_the_camera_stays_in_the_room(drawn):
    for room in drawn:
        limit = np.array([room.plan.width, room.plan.length]) / 2
        at = places(room)
        assert (np.abs(at[:, :2]) < limit - 0.3).all(), room.seed
        assert (at[:, 2] > 0.5).all(), room.seed
        assert (at[:, 2] < room.plan.height - 0.5).all(), room.seed


def test_people_keep_out_of_its_way(drawn):
    assert any(room.people for room in drawn)
    for room in drawn:
        walks = [shape.walk for shape in room.scene.shapes if shape.walk is not None]
        assert len(walks) == room.people
        for walk in walks:
            path = ClosedSpline(np.array(walk.path), closed=walk.closed)
            there = np.array([path.at(walk.start + walk.speed * t)[0] for t in INSTANTS])
            gaps = np.linalg.norm((there - places(room))[:, :2], axis=1)
            assert gaps.min() > APART_M - HAND_M, room.seed


def test_a_room_gives_a_row(drawn, capsys):
    room = drawn[25]
    small = replace(room.filming, camera=room.filming.camera.scaled(0.5))
    text = rooms.tabulate([replace(room, filming=small)], 8, others=True)
    row = text.splitlines()[2]
    assert row.startswith("| 25 | desk, ")
    assert "160 x 120" in row
    assert row.count("|") == 12
    assert row.count("none") == 5  # of eight frames none has another one a second before it
    assert "Of 8 frames edvo calls" in text
    assert "Of 7 errors of *tracked* frames, as against their keyframes, 100 % lie" in text
    assert text in capsys.readouterr().out


def score(error: float, lost: int = 0) -> rooms.Score:
    return rooms.Score(error, tracked=100 - lost, degraded=0, lost=lost, wrong=0)


def test_regions_are_asked_of_tracked_frames_that_have_one(drawn):
    """Of errors that are known, along all axes at once."""
    rng = np.random.default_rng(2)
    truth = np.array([se3.exp(rng.normal(0, 0.3, 6)) for _ in range(3)])
    C = np.diag([1e-4, 4e-6, 1e-6, 1e-6, 9e-6, 1e-8])
    T_key_cur = se3.inverse(truth[1]) @ truth[2]

    def off(sigmas):
        return se3.inverse(se3.exp(sigmas * np.sqrt(np.diag(C)))) @ T_key_cur

    result = TrackedFrame(
        index=2,
        timestamp=0.1,
        status=Status.TRACKED,
        reason="",
        T_key_cur=off(1.3),  # 6 * 1.3^2 = 10.1; the region ends at 10.6
        T_world_cam=np.eye(4),
        keyframe=1,
        is_keyframe=False,
        edges=0,
        samples=0,
        alignment=None,
        covariance=C,
    )
    assert rooms.has_region(result)
    assert rooms.is_inside(result, truth)
    assert not rooms.is_inside(replace(result, T_key_cur=off(1.36)), truth)
    assert not rooms.has_region(replace(result, covariance=None))
    assert not rooms.has_region(replace(result, keyframe=-1))
    assert not rooms.has_region(replace(result, status=Status.DEGRADED))
    text = rooms.summary([{"edvo": replace(score(2.0), told=80, inside=60)}])
    assert "Of 80 errors of *tracked* frames, as against their keyframes, 75 % lie" in text
    assert "lie" not in rooms.summary([{"edvo": score(2.0)}])


def test_who_has_too_few_poses_has_failed():
    assert rooms.least({"edvo": score(2.0), "direct": score(1.0, lost=51)}) == "edvo"
    assert rooms.least({"edvo": score(2.0), "direct": score(1.0, lost=50)}) == "direct"
    assert rooms.least({"edvo": score(np.inf), "direct": score(1.0, lost=51)}) is None
    few = [score(1.0), score(3.0), score(1.0, lost=60)]
    assert rooms.median_of("direct", few) == "direct 3.0 (failed in 1)"
    assert rooms.median_of("direct", few[2:]) == "direct none (failed in 1)"
    text = rooms.summary([{"edvo": score(2.0), "direct": one} for one in few])
    assert "edvo has the least error in 2 of 3 rooms" in text
    assert "Of 300 frames edvo calls 300 *tracked*" in text
