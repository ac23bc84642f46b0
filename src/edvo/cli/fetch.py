"""`edvo fetch`."""

import shlex
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import typer

from edvo.cli.interrupt import exit_status
from edvo.cli.terminal import note, say, table
from edvo.datasets.fetching import Entry, Watch, catalogue, find
from edvo.datasets.fetching import fetch as fetch_one
from edvo.datasets.fetching.sequence import unfinished
from edvo.errors import DatasetError


def list_sequences() -> None:
    """Say what can be fetched."""
    entries = catalogue()
    for data_set in dict.fromkeys(entry.data_set for entry in entries):
        say(data_set.title)
        say(f"licence: {data_set.licence}; {data_set.page}")
        say()
        rows = [
            [entry.name, _size(entry), "known" if entry.sha256 else "-"]
            for entry in entries
            if entry.data_set == data_set
        ]
        say(table(["sequence", "archive", "checksum"], rows))
        say()
    say("~ as the data set's page rounds it; ? not known. edvo fetch NAME fetches one.")


def fetch(
    names: list[str], out: Path, *, mirror: str | None, checksum: str | None, keep_archive: bool
) -> None:
    """Fetch sequences; see `edvo.cli.commands.fetch`."""
    entries = list(dict.fromkeys(find(name) for name in names))
    if checksum is not None and len(entries) > 1:
        raise DatasetError("--checksum is that of one archive; give one sequence with it")
    for entry in entries:
        with _transfer() as progress:
            try:
                done = fetch_one(
                    entry,
                    out,
                    mirror=mirror,
                    checksum=checksum,
                    keep_archive=keep_archive,
                    watch=Watch(progress, note),
                )
            except KeyboardInterrupt as interrupt:
                _say_how_to_go_on(entry, out)
                raise typer.Exit(exit_status(interrupt)) from interrupt
        if done.new:
            checked = f"checked against {done.checked_by}" if done.checked_by else "not checked"
            note(f"{entry.name}: {checked}; licence: {entry.data_set.licence}")
        say(str(done.folder))


def _say_how_to_go_on(entry: Entry, out: Path) -> None:
    kept = unfinished(entry, out)
    if kept is None:
        note("interrupted; nothing is kept")
        return
    command = shlex.join(["edvo", *sys.argv[1:]])
    note(f"interrupted; {kept.stat().st_size / 1e6:.1f} MB are kept in {kept}, to go on: {command}")


def _size(entry: Entry) -> str:
    if entry.size is None:
        return "?"
    about = "" if entry.exact else "~"
    return f"{about}{entry.size / 1e9:.2f} GB"


@contextmanager
def _transfer() -> Iterator[Callable[[str, int, int | None], None]]:
    """Show how many bytes have come while there is a terminal to show it on."""
    if not sys.stderr.isatty():
        yield lambda what, done, total: None
        return
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        DownloadColumn,
        Progress,
        TextColumn,
        TimeRemainingColumn,
        TransferSpeedColumn,
    )

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        DownloadColumn(),
        TransferSpeedColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        tasks: dict[str, int] = {}

        def progress(what: str, done: int, total: int | None) -> None:
            if what not in tasks:
                tasks[what] = bar.add_task(what, total=total)
            bar.update(tasks[what], completed=done, total=total)  # type: ignore[arg-type]

        yield progress
