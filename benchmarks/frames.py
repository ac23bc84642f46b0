"""Frames in memory to measure on: real sequences where there are any, else rendered ones."""

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, cycle
from pathlib import Path

from edvo.camera import Camera
from edvo.datasets import Source, open_source
from edvo.frame import Frame
from edvo.synthesis.sequence import SyntheticSource, make_recipe

ROOT = Path(__file__).resolve().parent.parent
DATA = Path(os.environ.get("EDVO_DATA", ROOT.parent / "shared" / "data"))
REAL = ("tum_fr3_structure_notexture_far", "tum_fr1_xyz", "icl_office_kt3")
RENDERED = ("notexture_far", "texture_near")
RATE = 30.0  # Hz, of frames that are shown back and forth


@dataclass(frozen=True)
class Recording:
    """Consecutive frames of one camera, decoded.

    Parameters
    ----------
    name : str
    origin : str
        What they are, for the report.
    camera : Camera
    frames : tuple of Frame
    source : Source
        Where they come from.
    """

    name: str
    origin: str
    camera: Camera
    frames: tuple[Frame, ...]
    source: Source

    def endless(self) -> Iterator[Frame]:
        """Give the frames back and forth, so that motion stays smooth, with stamps of a clock."""
        turn = chain(self.frames, self.frames[-2:0:-1])
        for count, frame in enumerate(cycle(turn)):
            yield replace(frame, timestamp=count / RATE)


def available() -> tuple[str, ...]:
    """Name the sequences to measure on: those real ones that are there, else the rendered."""
    return tuple(name for name in REAL if (DATA / name).is_dir()) or RENDERED


def open_recording(name: str, count: int) -> Source:
    """Open a sequence by name, without reading it."""
    if name in REAL:
        return open_source(DATA / name)
    return SyntheticSource(make_recipe(name, frames=count))


def recording(name: str, count: int) -> Recording:
    """Read the first ``count`` frames of a sequence; those that cannot be read are an error."""
    source = open_recording(name, count)
    frames: list[Frame] = []
    for index in range(min(count, len(source))):
        reading = source.read(index)
        if reading.frame is None:
            raise RuntimeError(f"{name}: {reading.problem}")
        frames.append(reading.frame)
    kind = "real" if name in REAL else "rendered by edvo.synthesis"
    return Recording(name, kind, source.camera, tuple(frames), source)


def recordings(count: int) -> tuple[Recording, ...]:
    """Read what there is."""
    return tuple(recording(name, count) for name in available())


def busiest(of: Sequence[Recording]) -> Recording:
    """Choose the one with most texture, which is the one with most edges."""
    wanted = ("tum_fr1_xyz", "texture_near")
    return next((r for name in wanted for r in of if r.name == name), of[-1])
