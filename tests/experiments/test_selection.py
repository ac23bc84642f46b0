"""Which sequences and frames are looked at."""

from dataclasses import replace

from edvo.experiments.bench import Bench
from edvo.experiments.selection import is_video, spread, texture_and_none, videos
from edvo.experiments.sequences import Loaded


def test_items_are_spread_evenly() -> None:
    assert spread(range(10), 5) == [1, 3, 5, 7, 9]
    assert spread(range(9), 3) == [1, 4, 7]
    assert spread([1, 2], 5) == [1, 2]
    assert spread([], 3) == []
    assert spread(range(7), 7) == list(range(7))


def test_without_recordings_there_are_a_textured_and_a_plain_sequence(bench: Bench) -> None:
    names = ["fr3/long_office_household", "fr3/structure_notexture_far"]
    assert [s.name for s in texture_and_none(bench)] == names
    assert [s.name for s in videos(bench)] == names


def test_a_frame_now_and_then_makes_no_video(bench: Bench) -> None:
    sequence = bench.sequence("fr3/structure_notexture_far")
    assert is_video(sequence)
    assert not is_video(replace(sequence, load=lambda: Loaded(sequence.frames[::20])))
    assert is_video(replace(sequence, load=lambda: Loaded(sequence.frames[:1])))
