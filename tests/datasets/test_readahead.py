import gc
import os
import sys
import threading
import time

import pytest

from edvo.datasets import Reading, open_source, read_ahead
from edvo.datasets.readahead import _NICENESS


class Slow:
    """A source that counts what is read and by whom."""

    def __init__(self, count=50, delay=lambda index: 0.0, bad=None):
        self.count, self.delay, self.bad = count, delay, bad
        self.begun, self.threads = [], set()

    def __len__(self):
        return self.count

    def read(self, index):
        self.begun.append(index)
        self.threads.add(threading.get_ident())
        time.sleep(self.delay(index))
        if index == self.bad:
            raise RuntimeError(f"frame {index} is cursed")
        return Reading(index, str(index), float(index), None, "not a real one")


def readers():
    return [thread for thread in threading.enumerate() if thread.name.startswith("edvo-read")]


def test_frames_come_in_order_whatever_takes_longest():
    source = Slow(delay=lambda index: 0.01 if index % 3 == 0 else 0.0)
    order = [*range(0, 50, 2), 1, 1, 0]
    assert [reading.index for reading in read_ahead(source, order, workers=4)] == order
    assert len(source.threads) > 1
    assert threading.get_ident() not in source.threads
    assert readers() == []


def test_it_reads_no_further_ahead_than_asked():
    source = Slow()
    drawn = []

    def indices():
        for index in range(50):
            drawn.append(index)
            yield index

    stream = read_ahead(source, indices(), ahead=5)
    for taken in range(1, 11):
        next(stream)
        assert len(drawn) == taken + 4
        assert len(source.begun) <= taken + 4
    stream.close()


def test_closing_stops_the_threads_and_what_was_not_begun():
    source = Slow(delay=lambda index: 0.5 if index else 0.0)  # 20 would take five seconds
    stream = read_ahead(source, range(50), workers=2, ahead=20)
    next(stream)
    stream.close()
    assert readers() == []
    assert len(source.begun) < 20


def test_dropping_it_stops_the_threads_too():
    stream = read_ahead(Slow(), range(50))
    next(stream)
    del stream
    gc.collect()
    assert readers() == []


def test_an_exception_arrives_in_its_place_and_ends_the_threads():
    stream = read_ahead(Slow(bad=7), range(50))
    taken = []
    with pytest.raises(RuntimeError, match="frame 7 is cursed"):
        taken.extend(reading.index for reading in stream)
    assert taken == list(range(7))
    assert readers() == []


def test_nothing_to_read_starts_and_ends():
    assert list(read_ahead(Slow(), [])) == []


@pytest.mark.parametrize("wrong", [{"workers": 0}, {"ahead": 0}])
def test_what_makes_no_sense_is_refused_at_once(wrong):
    with pytest.raises(ValueError, match="at least 1"):
        read_ahead(Slow(), range(3), **wrong)


def test_a_real_source_reads_the_same_ahead(make_folder):
    source = open_source(make_folder())
    for reading in read_ahead(source, range(len(source))):
        again = source.read(reading.index)
        assert (reading.frame.grey == again.frame.grey).all()
        assert (reading.frame.depth == again.frame.depth).all()


@pytest.mark.skipif(sys.platform != "linux", reason="threads have a niceness of their own on Linux")
def test_threads_give_way_and_the_caller_does_not():
    def niceness():
        return os.getpriority(os.PRIO_PROCESS, threading.get_native_id())

    class Asking:
        def read(self, index):
            return niceness()

    before = niceness()
    seen = list(read_ahead(Asking(), range(4)))
    assert seen == [min(before + _NICENESS, 19)] * 4
    assert niceness() == before
