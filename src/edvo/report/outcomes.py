"""The files of an experiment: a CSV file a table, a PNG file a figure, and outcome.json last."""

import csv
import io
import json
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from edvo.errors import OutputError
from edvo.experiments.experiment import Figure, Finding, Outcome, Table
from edvo.files import output_folder, write_atomically

OUTCOME = "outcome.json"


@dataclass(frozen=True)
class Kept:
    """An outcome as it lies in its folder.

    Parameters
    ----------
    outcome : Outcome
        What came out.
    seconds : float
        Time it took.
    """

    outcome: Outcome
    seconds: float


def write_outcome(
    outcome: Outcome, folder: Path, settings: Mapping[str, Any], seconds: float
) -> None:
    """Write an outcome, and in the place of an older one.

    Parameters
    ----------
    outcome : Outcome
        What to write.
    folder : pathlib.Path
        Where to; made if need be.
    settings : mapping
        What decided it, in what JSON knows.
    seconds : float
        Time it took.

    Raises
    ------
    OutputError
        If a file cannot be written; there is no outcome.json then.
    """
    _clear(output_folder(folder))
    for table in outcome.tables:
        write_atomically(folder / f"{table.name}.csv", table_csv(table))
    for figure in outcome.figures:
        write_atomically(folder / f"{figure.name}.png", figure.png)
    kept = {
        "name": outcome.name,
        "title": outcome.title,
        "settings": dict(settings),
        "seconds": round(seconds, 1),
        "tables": [
            {
                "name": table.name,
                "title": table.title,
                "header": table.header,
                "rows": table.rows,
                "records": [dict(record) for record in table.records],
            }
            for table in outcome.tables
        ],
        "figures": [{"name": f.name, "caption": f.caption} for f in outcome.figures],
        "findings": [
            {"claim": f.claim, "holds": f.holds, "sentence": f.sentence} for f in outcome.findings
        ],
        "notes": outcome.notes,
    }
    write_atomically(folder / OUTCOME, json.dumps(kept, indent=1, default=_plain) + "\n")


def read_outcome(folder: Path, settings: Mapping[str, Any]) -> Kept | None:
    """Read an outcome that was made with the same settings.

    Parameters
    ----------
    folder : pathlib.Path
        Where it lies.
    settings : mapping
        What decides it.

    Returns
    -------
    Kept or None
        None if there is none, or it is damaged, or was made with other settings.
    """
    try:
        kept = json.loads((folder / OUTCOME).read_text())
        if kept["settings"] != json.loads(json.dumps(settings)):
            return None
        outcome = Outcome(
            kept["name"],
            kept["title"],
            [
                Table(
                    table["name"],
                    table["title"],
                    tuple(table["header"]),
                    [tuple(row) for row in table["rows"]],
                    table["records"],
                )
                for table in kept["tables"]
            ],
            [
                Figure(f["name"], f["caption"], (folder / f"{f['name']}.png").read_bytes())
                for f in kept["figures"]
            ],
            [Finding(f["claim"], f["holds"], f["sentence"]) for f in kept["findings"]],
            tuple(kept["notes"]),
        )
        return Kept(outcome, float(kept["seconds"]))
    except (OSError, ValueError, KeyError, TypeError):
        return None


def table_csv(table: Table) -> str:
    """Give a table as CSV.

    Parameters
    ----------
    table : Table
        Its records, or its rows where it has none.

    Returns
    -------
    str
        A header and a line a record; what is None is empty.
    """
    text = io.StringIO()
    rows = csv.writer(text, lineterminator="\n")
    if not table.records:
        rows.writerow(table.header)
        rows.writerows(table.rows)
        return text.getvalue()
    columns = list(dict.fromkeys(key for record in table.records for key in record))
    rows.writerow(columns)
    rows.writerows([record.get(column) for column in columns] for record in table.records)
    return text.getvalue()


def _clear(folder: Path) -> None:
    """Take away what an older outcome left, its outcome.json first."""
    place = folder / OUTCOME
    try:
        old = json.loads(place.read_text())
        names = [f"{t['name']}.csv" for t in old["tables"]]
        names += [f"{f['name']}.png" for f in old["figures"]]
    except (OSError, ValueError, KeyError, TypeError):
        names = []
    try:
        place.unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(f"cannot replace {place}: {error.strerror}") from error
    for name in names:
        with suppress(OSError):  # a file too many harms nobody
            (folder / name).unlink(missing_ok=True)


def _plain(value: Any) -> Any:
    """Give NumPy's numbers as Python's."""
    return value.item()
