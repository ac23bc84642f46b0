"""`edvo reproduce`."""

import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import typer

from edvo.cli.compiling import compile_now
from edvo.cli.interrupt import exit_status
from edvo.cli.terminal import note, say
from edvo.config import PRESETS, Config
from edvo.experiments.bench import Bench
from edvo.experiments.registry import EXPERIMENTS
from edvo.files import output_folder
from edvo.report.demo import renderer_compiling_aside
from edvo.report.reproduction import (
    FAILURE,
    PAGE,
    SUMMARY,
    Stage,
    completed,
    run_stages,
    write_pages,
)
from edvo.report.reproduction_words import SIGNS, in_words, tally

if TYPE_CHECKING:
    from rich.progress import Progress, TaskID

ALL = "all"


def reproduce(
    what: Sequence[str],
    out: Path,
    *,
    data: Path | None,
    quick: bool,
    seed: int,
    max_frames: int | None,
    force: bool,
) -> None:
    """Make tables and figures of the paper again; see `edvo.cli.commands.reproduce`."""
    names = chosen(what)
    with _watching(len(names)) as watch:
        bench = Bench(
            out,
            data=data,
            quick=quick,
            seed=seed,
            limit=max_frames,
            render_again=force,
            advance=watch.detail,
        )
        folder = output_folder(out)
        for line in bench.notes:
            note(line)
        cv2.setNumThreads(1)  # frames share the cores; OpenCV's own threads would only contend
        done = {stage.name for stage in completed(bench, folder, EXPERIMENTS)}
        if force or not done.issuperset(names):
            with renderer_compiling_aside():
                compile_now(*map(Config.preset, PRESETS))
        begin = time.perf_counter()
        stages: list[Stage] = []
        try:
            for stage in run_stages(
                names, bench, folder, EXPERIMENTS, force=force, on_begin=watch.stage
            ):
                stages.append(stage)
                watch.done()
                _tell(stage)
        except KeyboardInterrupt as interrupt:
            _write(stages, bench, folder)
            whole = sum(stage.outcome is not None for stage in stages)
            note(
                f"interrupted; {whole} of {len(names)} are complete in {folder}, "
                "and the same command goes on from there"
            )
            raise typer.Exit(exit_status(interrupt)) from None
    _write(stages, bench, folder)
    seconds = time.perf_counter() - begin
    say(f"wrote {folder / PAGE}, {SUMMARY} and a folder for each ({seconds:.0f} s)")
    lost = [stage.name for stage in stages if stage.outcome is None]
    if lost:
        note(
            f"failed: {', '.join(lost)}; {folder / lost[0] / FAILURE} has the whole story, and "
            "the same command tries again"
        )
        raise typer.Exit(1)


def chosen(what: Sequence[str]) -> list[str]:
    """Look up what is wanted, each once and in the paper's order."""
    known = [*EXPERIMENTS, ALL]
    for name in what:
        if name not in known:
            raise typer.BadParameter(f"there is no {name!r}; choose of {', '.join(known)}")
    return [name for name in EXPERIMENTS if name in what or ALL in what]


def _write(stages: Sequence[Stage], bench: Bench, folder: Path) -> None:
    """Write the pages: these stages, and what was complete before."""
    shown = {stage.name: stage for stage in completed(bench, folder, EXPERIMENTS)}
    shown.update({stage.name: stage for stage in stages})
    write_pages([shown[name] for name in EXPERIMENTS if name in shown], bench, folder)


def _tell(stage: Stage) -> None:
    if stage.outcome is None:
        note(f"{stage.name} failed: {stage.problem}")
        return
    how = "complete already" if stage.resumed else f"{stage.seconds:.0f} s"
    say(f"{stage.name}: {stage.title} ({how}); {tally(stage.outcome.findings)}")
    for finding in stage.outcome.findings:
        say(f"  {SIGNS[finding.holds]}: {in_words(finding)}")


@dataclass
class _Watch:
    """A progress bar, or nothing where there is no terminal."""

    bar: "Progress | None" = None
    task: "TaskID | None" = None
    name: str = ""

    def stage(self, name: str) -> None:
        self.name = name
        self.detail("")

    def detail(self, text: str) -> None:
        if self.bar is not None and self.task is not None:
            self.bar.update(self.task, description=f"{self.name} {text}".strip())

    def done(self) -> None:
        if self.bar is not None and self.task is not None:
            self.bar.advance(self.task)


@contextmanager
def _watching(total: int) -> Iterator[_Watch]:
    if not sys.stderr.isatty():
        yield _Watch()
        return
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        SpinnerColumn,
        TextColumn,
        TimeElapsedColumn,
    )

    columns = (
        SpinnerColumn(),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("{task.description}"),
    )
    # Results that go to a file must not be drawn above the bar instead.
    redirect = sys.stdout.isatty()
    console = Console(stderr=True)
    with Progress(*columns, console=console, transient=True, redirect_stdout=redirect) as bar:
        yield _Watch(bar, bar.add_task("", total=total))
