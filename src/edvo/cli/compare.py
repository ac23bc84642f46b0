"""`edvo compare`."""

import json
import re
import shlex
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain, count
from pathlib import Path

import cv2
import typer

from edvo.baselines.registry import EDVO_NAMES, ZERO_MOTION, baseline_names
from edvo.cli.compiling import compile_now
from edvo.cli.interrupt import stop_on_interrupt
from edvo.cli.recording import open_recording
from edvo.cli.terminal import note, progress, say, table
from edvo.config import Config
from edvo.datasets import Source
from edvo.datasets.inspection.unit import check_unit
from edvo.errors import ConfigError, DatasetError, EvaluationError
from edvo.experiments.variants import variants_of
from edvo.files import Unwritten, output_folder, write_atomically
from edvo.report.compare import Comparison, System, compare_source
from edvo.report.compare_memory import MEMORY_FRAMES, frames_on_disk, peak_megabytes
from edvo.report.compare_rank import summary_verdicts, verdicts
from edvo.report.compare_sources import SCENE_FRAMES, find_sources, open_any
from edvo.report.compare_systems import edvo_and, variant_systems
from edvo.report.compare_tables import cells, describe, markdown, summary_cells, to_csv, to_json
from edvo.report.tracking import choose_frames
from edvo.trajectory import Trajectory

DEFAULT_PEERS = ("opencv-rgbd", "opencv-rgb")
"""Whom edvo is compared with where nobody is named: the best of what the base install has."""

MARKDOWN, CSV, JSON = "compare.md", "compare.csv", "compare.json"
FILES = (MARKDOWN, CSV, JSON)
TRAJECTORIES = "trajectories"
NAME_MARK = "{name}"
"""In the file name of a trajectory it stands for the name of the sequence."""

_PROBLEMS_SHOWN = 3
_BUSY = 1.5  # wall over processor time of edvo, which computes in one thread


def compare(
    sources: Sequence[str],
    *,
    peers: Sequence[str],
    trajectories: Sequence[str],
    variants: bool,
    out: Path | None,
    preset: str | None,
    seed: int,
    repeats: int,
    camera: str | None,
    format: str | None,
    colour_topic: str | None,
    depth_topic: str | None,
    light: str | None,
    severity: float | None,
    start: int,
    max_frames: int | None,
    stride: int,
    memory: bool,
) -> None:
    """Track recordings by several systems and compare them; see `edvo.cli.commands.compare`."""
    if preset is not None and not variants:
        raise ConfigError("--preset says what --variants changes; without it both are compared")
    if severity is not None and light is None:
        raise ConfigError("--severity says how hard --light changes; name a model of light")
    files = _named_files(trajectories)
    base = f"edvo-{preset or 'paper'}" if variants else EDVO_NAMES[0]
    if not (peers or files or variants):
        peers = DEFAULT_PEERS
    systems = edvo_and(peers, repeats=repeats, later=variants)
    if variants:
        changed = variant_systems(preset or "paper", repeats=repeats)
        systems = [*changed, *(system for system in systems if system.name != base)]
    found = find_sources(sources, format=format, note=note)
    open_path = partial(open_recording, colour_topic=colour_topic, depth_topic=depth_topic)
    jobs = []
    for text in found:
        source = open_any(
            text,
            format=format,
            camera=camera,
            frames=start + stride * (max_frames or SCENE_FRAMES),
            light=light,
            severity=0.5 if severity is None else severity,
            seed=seed,
            open_path=open_path,
        )
        indices = choose_frames(source, start=start, max_frames=max_frames, stride=stride)
        jobs.append(Job(source, indices, _read(files, source.name)))
    _check_names(peers, systems, files, jobs[0].source)
    results = Results(None if out is None else output_folder(out, files=FILES))
    for job in jobs:
        stamps = check_unit(job.source.timestamps)
        for warning in (*job.source.warnings, *stamps.warnings):
            note(f"warning: {job.source.name}: {warning}")
    # While a system is timed, nothing else may compute.
    cv2.setNumThreads(1)
    for name in EDVO_NAMES:
        compile_now(Config.preset(name.removeprefix("edvo-")))
    parameters = variants_of(preset or "paper") if variants else {}
    unwritten = Unwritten()
    with stop_on_interrupt() as stop:
        for job in jobs:
            if stop():
                break
            done = _compare_one(job, systems, base, seed=seed, stop=stop)
            if memory:
                done = _with_memory(done, job, parameters, seed=seed, stop=stop)
            with unwritten.noted():
                _report(done)
            results.add(done)
        interrupted = stop()
    unwritten.check()
    results.finish()
    if interrupted:
        whole = sum(not each.interrupted for each in results.comparisons)
        note(f"interrupted after {whole} of {len(jobs)} sequences; what was done is shown")
        raise typer.Exit(stop.status)
    for each in results.comparisons:
        if each.unreadable and len(each.unreadable) == each.frames:
            raise DatasetError(f"{each.name}: no frame could be read; {each.unreadable[0]}")


@dataclass(frozen=True)
class Job:
    """One sequence, and what takes part only there."""

    source: Source
    indices: range
    trajectories: Mapping[str, Trajectory]


class Results:
    """What is done so far, kept in files if there is a folder for them."""

    def __init__(self, folder: Path | None) -> None:
        self.comparisons: list[Comparison] = []
        self._folder = folder
        self._pictures: list[list[str]] = []
        self._files: list[str] = []
        self._command = shlex.join(["edvo", *sys.argv[1:]])

    def add(self, comparison: Comparison) -> None:
        """Take a sequence in, and write everything anew, each file whole or not at all."""
        if not comparison.frames:
            return
        taken = {each.name for each in self.comparisons}
        numbers = (f"{comparison.name}-{k}" for k in count(2))
        name = next(n for n in chain([comparison.name], numbers) if n not in taken)
        comparison = replace(comparison, name=name)
        self.comparisons.append(comparison)
        if self._folder is None:
            return
        if len(self.comparisons) == 1:
            remove_earlier(self._folder)
        self._pictures.append(self._draw(comparison, self._folder))
        self._files += self._pictures[-1]
        self._files += self._write_trajectories(comparison, self._folder)
        page = markdown(self.comparisons, command=self._command, pictures=self._pictures)
        write_atomically(self._folder / MARKDOWN, page)
        write_atomically(self._folder / CSV, to_csv(self.comparisons))
        whole = to_json(self.comparisons, command=self._command, files=self._files)
        write_atomically(self._folder / JSON, whole)

    def finish(self) -> None:
        """Say what all sequences come to, and where it is kept."""
        edvo = [row for each in self.comparisons for row in each.rows if row.kind == "edvo"]
        if any(row.is_timed and row.median_s > _BUSY * row.median_cpu_s for row in edvo):
            note("warning: the machine is busy, edvo waits for a processor; compare the CPU times")
        if len(self.comparisons) > 1:
            say(table(*summary_cells(self.comparisons)))
            for line in summary_verdicts(self.comparisons):
                say(line)
            say()
        if self._folder is not None and self.comparisons:
            say(f"wrote {self._folder / MARKDOWN}, {CSV}, {JSON}, pictures and {TRAJECTORIES}/")

    def _draw(self, comparison: Comparison, folder: Path) -> list[str]:
        from edvo.report.compare_plots import draw_errors, draw_paths

        written = []
        for what, draw in (("paths", draw_paths), ("errors", draw_errors)):
            picture = draw(comparison)
            if picture is not None:
                written.append(f"{_slug(comparison.name)}-{what}.png")
                write_atomically(folder / written[-1], picture)
        return written

    def _write_trajectories(self, comparison: Comparison, folder: Path) -> list[str]:
        place = f"{TRAJECTORIES}/{_slug(comparison.name)}"
        output_folder(folder / place)
        written = []
        for row in comparison.rows:
            if row.score is not None and row.kind not in ("trajectory", "reference"):
                written.append(f"{place}/{_slug(row.name)}.txt")
                row.score.trajectory.write(folder / written[-1])
        return written


def remove_earlier(folder: Path) -> None:
    """Remove pictures and trajectories of an earlier comparison, and nothing that it did not write.

    Parameters
    ----------
    folder : pathlib.Path
        Where this one goes; nothing happens unless it has a list of an earlier one's files.
    """
    try:
        files = json.loads((folder / JSON).read_text(encoding="utf-8"))["files"]
        places = [(folder / name).resolve() for name in files]
    except (OSError, ValueError, LookupError, TypeError):
        return  # none, or not one of ours
    home = folder.resolve()
    for place in places:
        if place.suffix in (".png", ".txt") and home in place.parents:
            with suppress(OSError):
                place.unlink()
            with suppress(OSError):  # it stays if it holds anything else
                place.parent.rmdir()


def _named_files(trajectories: Sequence[str]) -> dict[str, str]:
    files: dict[str, str] = {}
    for each in trajectories:
        name, equals, file = each.partition("=")
        if not (name and equals and file):
            raise ConfigError(f"--trajectory {each}: write NAME=FILE")
        if name in files:
            raise ConfigError(f"--trajectory {name} is given twice; give each another name")
        if name in (*baseline_names(), ZERO_MOTION):
            raise ConfigError(f"--trajectory {name}: edvo runs that itself; choose another name")
        files[name] = file
    return files


def _read(files: Mapping[str, str], sequence: str) -> dict[str, Trajectory]:
    return {
        name: Trajectory.read(file.replace(NAME_MARK, sequence)) for name, file in files.items()
    }


def _check_names(
    peers: Sequence[str], systems: Sequence[System], files: Mapping[str, str], source: Source
) -> None:
    """Refuse what is asked for by name and cannot be had, before anything takes time."""
    for system in systems:
        if system.name in peers:
            system.make(source.camera, 0)  # says how to install it, if it is missing
        if system.name in files:
            raise ConfigError(
                f"--trajectory {system.name}: a variant has that name; choose another"
            )


def _compare_one(
    job: Job, systems: Sequence[System], base: str, *, seed: int, stop: Callable[[], bool]
) -> Comparison:
    with progress(job.source.name, len(job.indices)) as advance:
        return compare_source(
            job.source,
            systems,
            trajectories=job.trajectories,
            indices=job.indices,
            seed=seed,
            base=base,
            on_frame=advance,
            stop=stop,
        )


def _with_memory(
    comparison: Comparison,
    job: Job,
    parameters: Mapping[str, Config],
    *,
    seed: int,
    stop: Callable[[], bool],
) -> Comparison:
    """Add to each row the memory that its system takes."""
    readings = [job.source.read(index) for index in job.indices[:MEMORY_FRAMES]]
    frames = [reading.frame for reading in readings if reading.frame is not None]
    rows = []
    with (
        progress(f"{job.source.name}: memory", len(comparison.rows)) as advance,
        frames_on_disk(frames) as file,
    ):
        for row in comparison.rows:
            if frames and row.wall_s.size and not stop():
                system = parameters.get(row.name, row.name)
                try:
                    peak = peak_megabytes(file, job.source.camera, system, seed=seed)
                    row = replace(row, memory_mb=peak)
                except EvaluationError as error:
                    note(f"{row.name}: {error}")
            rows.append(row)
            advance()
    return replace(comparison, rows=tuple(rows))


def _report(comparison: Comparison) -> None:
    for problem in comparison.unreadable[:_PROBLEMS_SHOWN]:
        note(f"skipped: {problem}")
    if len(comparison.unreadable) > _PROBLEMS_SHOWN:
        note(f"skipped {len(comparison.unreadable)} frames in all")
    if not comparison.frames:
        return
    say(f"{comparison.name}: {describe(comparison)}")
    say(table(*cells(comparison)))
    for line in verdicts(comparison):
        say(line)
    say()


def _slug(name: str) -> str:
    """Make a file name."""
    return re.sub(r"[^\w.+-]+", "-", name).strip("-")
