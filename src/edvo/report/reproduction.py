"""Running the experiments one after the other so that none is lost, and writing what they gave."""

import time
import traceback
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from edvo.errors import EdvoError, OutputError
from edvo.experiments.bench import Bench
from edvo.experiments.experiment import Experiment, Outcome
from edvo.files import output_folder, write_atomically
from edvo.report.outcomes import OUTCOME, read_outcome, write_outcome
from edvo.report.reproduction_markdown import markdown
from edvo.report.reproduction_page import page

PAGE = "index.html"
SUMMARY = "summary.md"
FAILURE = "failure.txt"


@dataclass(frozen=True)
class Stage:
    """An experiment that was run, found complete, or failed.

    Parameters
    ----------
    name : str
        Of the experiment.
    title, paper : str
        What it is, and what the paper shows there.
    outcome : Outcome or None
        What came out; None if it failed.
    problem : str
        Why it failed, in a line.
    seconds : float
        Time it took, when it was run.
    resumed : bool
        Whether it was complete already.
    """

    name: str
    title: str
    paper: str
    outcome: Outcome | None
    problem: str = ""
    seconds: float = 0.0
    resumed: bool = False


def run_stages(
    names: Sequence[str],
    bench: Bench,
    folder: Path,
    experiments: Mapping[str, Experiment],
    *,
    force: bool = False,
    on_begin: Callable[[str], None] | None = None,
) -> Iterator[Stage]:
    """Run experiments; what is complete with the same settings is read instead.

    Parameters
    ----------
    names : sequence of str
        Which.
    bench : Bench
        What they work with.
    folder : pathlib.Path
        Each writes to a folder of its name in it.
    experiments : mapping
        Where the names are looked up.
    force : bool
        Run also what is complete.
    on_begin : callable, optional
        Told the name of each one before it is run or read.

    Yields
    ------
    Stage
        One for each, as it is finished. One that fails is told with its reason, and the whole
        story is in ``failure.txt`` in its folder.
    """
    for name in names:
        if on_begin is not None:
            on_begin(name)
        yield _stage(name, bench, folder / name, experiments, force=force)


def completed(bench: Bench, folder: Path, experiments: Mapping[str, Experiment]) -> list[Stage]:
    """Find what is complete with the same settings.

    Parameters
    ----------
    bench : Bench
        What it was made with.
    folder : pathlib.Path
        Where `run_stages` wrote it.
    experiments : mapping
        Where the names are looked up.

    Returns
    -------
    list of Stage
        In the order of the experiments.
    """
    found = []
    for name in experiments:
        if (folder / name / OUTCOME).exists():
            stage = _resumed(name, bench, folder / name, experiments)
            if stage is not None:
                found.append(stage)
    return found


def write_pages(stages: Sequence[Stage], bench: Bench, folder: Path) -> None:
    """Write index.html, which needs no other file, and summary.md.

    Parameters
    ----------
    stages : sequence of Stage
        What is shown.
    bench : Bench
        What it was made with.
    folder : pathlib.Path
        Where to.

    Raises
    ------
    OutputError
        If a page cannot be written.
    """
    output_folder(folder)
    write_atomically(folder / SUMMARY, markdown(stages, bench))
    write_atomically(folder / PAGE, page(stages, bench))


def _stage(
    name: str,
    bench: Bench,
    folder: Path,
    experiments: Mapping[str, Experiment],
    *,
    force: bool,
) -> Stage:
    title, paper = name, ""
    begin = time.perf_counter()
    try:
        experiment = experiments[name]
        title, paper = experiment.title, experiment.paper
        found = None if force else _resumed(name, bench, folder, experiments)
        if found is not None:
            return found
        settings = bench.settings()
        outcome = experiment.run(bench)
        seconds = time.perf_counter() - begin
        write_outcome(outcome, folder, settings, seconds)
    except Exception as error:  # whatever is wrong with one must not lose the others
        seconds = time.perf_counter() - begin
        problem = _in_a_line(error)
        with suppress(OutputError):
            output_folder(folder)
            write_atomically(folder / FAILURE, traceback.format_exc())
        return Stage(name, title, paper, None, problem, seconds)
    with suppress(OSError):
        (folder / FAILURE).unlink(missing_ok=True)
    return Stage(name, title, paper, outcome, "", seconds)


def _resumed(
    name: str, bench: Bench, folder: Path, experiments: Mapping[str, Experiment]
) -> Stage | None:
    kept = read_outcome(folder, bench.settings())
    if kept is None:
        return None
    experiment = experiments[name]
    return Stage(
        name, experiment.title, experiment.paper, kept.outcome, "", kept.seconds, resumed=True
    )


def _in_a_line(error: Exception) -> str:
    said = " ".join(str(error).split())
    return said if isinstance(error, EdvoError) and said else f"{type(error).__name__}: {said}"
