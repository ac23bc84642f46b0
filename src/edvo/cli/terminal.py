"""Words for people: results on standard output, all else on standard error."""

import logging
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

import typer

from edvo.cli import cannot_print, silence_output
from edvo.errors import OutputError

Advance = Callable[[], None]


def say(line: str = "") -> None:
    """Print a line of the result; `OutputError` if there is no room where it goes."""
    try:
        typer.echo(line)
    except BrokenPipeError:
        raise  # nobody reads it, which is no fault
    except OSError as error:
        silence_output()
        raise OutputError(cannot_print(error)) from error


def note(line: str) -> None:
    """Print a line beside the result."""
    typer.echo(f"edvo: {line}", err=True)


class Notes(logging.Handler):
    """Prints what the library logs as notes, but for the tracker's.

    Each command sums up the frames that are lost; a line for each would drown that.
    """

    def emit(self, record: logging.LogRecord) -> None:
        """Print one."""
        if record.name != "edvo.odometry":
            note(record.getMessage())


def table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Lay out rows in columns, the first one to the left and the others to the right.

    Parameters
    ----------
    header : sequence of str
        Names of the columns.
    rows : sequence of sequence of str
        Cells, as many in each row as the header has.

    Returns
    -------
    str
        Lines of equal layout in a terminal and in a pipe.
    """
    lines = [header, *rows]
    widths = [max(len(line[column]) for line in lines) for column in range(len(header))]
    shown = []
    for line in lines:
        first, *others = (
            cell.rjust(width) if column else cell.ljust(width)
            for column, (cell, width) in enumerate(zip(line, widths, strict=True))
        )
        shown.append("  ".join([first, *others]).rstrip())
    shown.insert(1, "  ".join("-" * width for width in widths))
    return "\n".join(shown)


@contextmanager
def progress(what: str, total: int) -> Iterator[Advance]:
    """Show a progress bar while there is a terminal to show it on.

    Parameters
    ----------
    what : str
        What is going on.
    total : int
        Steps.

    Yields
    ------
    callable
        To be called after each step.
    """
    if not sys.stderr.isatty():
        yield lambda: None
        return
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeRemainingColumn,
    )

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(what, total=total)
        yield lambda: bar.advance(task)


@contextmanager
def status_line(what: str) -> Iterator[Callable[[str], None]]:
    """Show a line that changes while there is a terminal to show it on.

    Parameters
    ----------
    what : str
        What it says at first.

    Yields
    ------
    callable
        To be called with each new text.
    """
    if not sys.stderr.isatty():
        yield lambda text: None
        return
    from rich.console import Console
    from rich.text import Text

    with Console(stderr=True).status(Text(what)) as status:
        yield lambda text: status.update(Text(text))
