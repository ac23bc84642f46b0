"""A bench that is small enough for tests."""

from pathlib import Path
from typing import Any

from edvo.experiments.bench import Bench
from edvo.synthesis.sequence import (
    DEFAULT_CAMERA,
    SyntheticSource,
    make_recipe,
    write_sequence,
)

CAMERA = DEFAULT_CAMERA.scaled(0.25)
FRAMES = 42  # long enough for an error over one second


def tiny_bench(folder: Path, frames: int = FRAMES, **more: Any) -> Bench:
    """Make a quick bench of small synthetic images."""
    return Bench(folder, quick=True, stand_in_frames=frames, camera=CAMERA, **more)


def write_recording(folder: Path, frames: int) -> Path:
    """Write what passes for a recording."""
    source = SyntheticSource(make_recipe("cabinet", frames=frames, camera=CAMERA))
    folder.parent.mkdir(parents=True, exist_ok=True)
    return write_sequence(source, folder, workers=1)
