"""The newest frame counts: what is dropped, what ends it, what comes through."""

import threading
import time
from collections.abc import Iterator

import numpy as np
import pytest

from edvo import Camera, Frame, Odometry
from edvo.errors import FrameError
from edvo.live import Latest, follow

PATIENCE_S = 60  # of what comes at once, but for a busy machine
CAMERA = Camera(width=64, height=48, fx=50.0, fy=50.0, cx=31.5, cy=23.5)


def frame(index: int, width: int = 64) -> Frame:
    grey = np.zeros((48, width), np.uint8)
    return Frame(index / 30, grey, np.ones((48, width), np.float32))


def test_all_come_in_order_where_there_is_time() -> None:
    taken = threading.Semaphore(1)

    def patient() -> Iterator[int]:
        for index in range(50):
            assert taken.acquire(timeout=PATIENCE_S)
            yield index

    seen = []
    with Latest(patient()) as latest:
        for item in latest:
            seen.append(item)
            taken.release()
        assert latest.dropped == 0
    assert seen == list(range(50))


def test_a_slow_taker_gets_the_newest_and_none_twice() -> None:
    shown = threading.Semaphore(0)
    five_more = threading.Event()

    def hasty() -> Iterator[int]:
        for index in range(11):
            yield index
            if index == 0:
                assert five_more.wait(PATIENCE_S)
            shown.release()

    with Latest(hasty()) as latest:
        assert next(latest) == 0
        five_more.set()
        for _ in range(11):  # the generator has gone on to its end
            assert shown.acquire(timeout=PATIENCE_S)
        assert next(latest) == 10
        assert latest.dropped == 9
        with pytest.raises(StopIteration):
            next(latest)


def test_what_the_camera_raises_comes_after_its_last_frame() -> None:
    def broken() -> Iterator[int]:
        yield 1
        raise OSError("unplugged")

    with Latest(broken()) as latest:
        assert next(latest) == 1
        with pytest.raises(OSError, match="unplugged"):
            next(latest)
        with pytest.raises(StopIteration):
            next(latest)


def test_stop_ends_it_while_no_frame_comes() -> None:
    end, stop, ended = threading.Event(), threading.Event(), threading.Event()

    def silent() -> Iterator[int]:
        end.wait(PATIENCE_S)
        ended.set()
        yield from ()

    with Latest(silent(), stop.is_set) as latest:
        threading.Timer(0.2, stop.set).start()
        assert list(latest) == []
        assert not ended.is_set()
        end.set()


def test_closing_ends_the_thread_and_the_generator() -> None:
    closed = threading.Event()

    def endless() -> Iterator[int]:
        try:
            while True:
                time.sleep(0.005)
                yield 1
        finally:
            closed.set()

    before = set(threading.enumerate())
    with Latest(endless()) as latest:
        (thread,) = (t for t in set(threading.enumerate()) - before if t.name == "edvo-live")
        next(latest)
    assert closed.wait(PATIENCE_S)
    thread.join(PATIENCE_S)
    assert not thread.is_alive()


def test_follow_tracks_and_counts() -> None:
    with follow((frame(index) for index in range(30)), Odometry(CAMERA)) as following:
        tracked = list(following)
    assert len(tracked) + following.dropped == 30
    assert tracked[-1].timestamp == frame(29).timestamp
    assert [result.index for result in tracked] == list(range(len(tracked)))


def test_follow_says_which_frame_does_not_fit() -> None:
    following = follow([frame(0, width=32)], Odometry(CAMERA))
    with following, pytest.raises(FrameError, match="32 x 48"):
        next(following)
