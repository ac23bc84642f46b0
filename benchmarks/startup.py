"""How long a user waits: for help, and for the first pose of a run once all is compiled."""

from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

from benchmarks.edvo_program import edvo, folder_of
from benchmarks.section import Bound, Section, Settings, table

FRAMES = 2  # the first is the origin; the second has a pose that was found


def measure(settings: Settings) -> Section:
    """Time whole processes; the first of each kind warms the caches and is not counted."""
    repeats = settings.choose(3, 5)
    with folder_of(settings.recordings[0]) as folder, TemporaryDirectory() as out:
        run = ("run", folder, "-o", Path(out), "--max-frames", str(FRAMES))
        first = [edvo(*run) for _ in range(repeats + 1)][1:]
    helped = [edvo("--help") for _ in range(repeats + 1)][1:]
    rows = [
        ["`edvo --help`", f"{median(helped):.2f}", f"{min(helped):.2f}-{max(helped):.2f}"],
        [
            f"`edvo run --max-frames {FRAMES}`",
            f"{median(first):.2f}",
            f"{min(first):.2f}-{max(first):.2f}",
        ],
    ]
    body = (
        "Wall time of the whole process, started as from a shell, kernels compiled before; the "
        "run reads two frames, registers the second and writes all its files, which is more than "
        "the first pose takes.\n\n"
        + table(["command", f"seconds, median of {repeats}", "least and most"], rows)
    )
    bounds = [
        Bound("edvo --help", 0.5, median(helped), " s"),
        Bound("first pose of a warm run, whole process", 2.0, median(first), " s"),
    ]
    return Section("Waiting", body, bounds)
