"""What an experiment is, and what comes out of one."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from edvo.experiments.bench import Bench

Value = str | int | float | bool | None
"""What a cell of a CSV file may be; None is empty."""


@dataclass(frozen=True)
class Table:
    """Numbers in rows, for people and for programs.

    Parameters
    ----------
    name : str
        Of its CSV file, without the ending.
    title : str
        Above it.
    header : tuple of str
        Names of the columns.
    rows : sequence of tuple of str
        Cells as people read them, as many in each row as in the header; ``**bold**`` for the
        best.
    records : sequence of mapping of str to Value
        The same as bare numbers with units in their names, a row of the CSV file each; the rows
        themselves go there where there are none.
    """

    name: str
    title: str
    header: tuple[str, ...]
    rows: Sequence[tuple[str, ...]]
    records: Sequence[Mapping[str, Value]] = ()

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.header):
                raise ValueError(f"table {self.name}: {len(row)} cells under {self.header}: {row}")


@dataclass(frozen=True)
class Figure:
    """A picture.

    Parameters
    ----------
    name : str
        Of its file, without the ending.
    caption : str
        Below it: what is seen.
    png : bytes
        The file.
    """

    name: str
    caption: str
    png: bytes = field(repr=False)


@dataclass(frozen=True)
class Finding:
    """A claim of the paper, held against the numbers measured here.

    Parameters
    ----------
    claim : str
        What the paper says.
    holds : bool or None
        Whether it holds in these numbers; None where they cannot say.
    sentence : str
        The same in words, with the numbers.
    """

    claim: str
    holds: bool | None
    sentence: str


@dataclass(frozen=True)
class Outcome:
    """What came out of an experiment.

    Parameters
    ----------
    name, title : str
        Of the experiment.
    tables : sequence of Table
        Numbers measured here, with the published ones beside them.
    figures : sequence of Figure
        Pictures in the form of the paper's.
    findings : sequence of Finding
        One for each claim.
    notes : tuple of str
        What a reader must know besides: stand-ins, what is missing and why.
    """

    name: str
    title: str
    tables: Sequence[Table]
    figures: Sequence[Figure]
    findings: Sequence[Finding]
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Experiment:
    """A table or figure of the paper, to be made again.

    Parameters
    ----------
    name : str
        Such as ``fig8``.
    title : str
        In a line.
    paper : str
        What the paper shows there.
    run : callable
        Makes it from what a `Bench` gives.
    """

    name: str
    title: str
    paper: str
    run: "Callable[[Bench], Outcome]"
