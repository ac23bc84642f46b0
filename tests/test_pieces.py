"""Which piece of the path a camera is in, and when it looks for what was before."""

import pytest

from edvo.pieces import LONGEST_S, PERIOD_S, Pieces


def test_each_beginning_has_a_number_of_its_own():
    pieces = Pieces()
    assert (pieces.here, pieces.following) == (0, 1)
    pieces.begin(10.0, 9.0)
    assert (pieces.here, pieces.following) == (1, 2)
    pieces.enter(0, 12.0)  # found
    pieces.begin(20.0, 19.0)
    assert pieces.here == 2


def test_the_gap_counts_from_when_the_first_piece_was_left():
    pieces = Pieces()
    pieces.begin(10.0, 9.0)
    pieces.begin(13.0, 12.5)  # lost once more: still as far from the first
    assert pieces.gap(14.0) == 5.0
    pieces.enter(0, 13.5)
    pieces.enter(1, 20.0)  # from the first piece into one that was left before
    assert pieces.gap(21.0) == 1.0
    assert pieces.gap(19.0) == 0.0  # stamps that go back a little


def test_it_asks_ever_more_seldom():
    pieces = Pieces()
    pieces.begin(0.0, 0.0)
    asked = [k / 30 for k in range(1, 3000) if pieces.may_ask(k / 30)]
    waits = [b - a for a, b in zip([0.0, *asked], asked, strict=False)]
    assert waits[0] == pytest.approx(PERIOD_S, abs=0.05)
    assert waits[-1] == pytest.approx(LONGEST_S, abs=0.05)
    assert waits == pytest.approx(sorted(waits), abs=0.05)


def test_after_a_clock_has_jumped_back_it_may_ask_at_once():
    pieces = Pieces()
    pieces.begin(100.0, 99.0)
    assert not pieces.may_ask(100.1)
    pieces.rewind(5.0)
    assert pieces.may_ask(5.0)
    assert not pieces.may_ask(5.1)
    assert pieces.gap(6.0) == 1.0
