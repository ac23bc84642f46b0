"""What every section of the report takes and gives."""

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

from benchmarks.frames import Recording, recordings
from edvo.report.markdown_table import markdown_table

table = markdown_table


@dataclass(frozen=True)
class Settings:
    """How long to measure, and where pictures go.

    Parameters
    ----------
    quick : bool
        Few frames and repetitions: to see that it works, not to quote.
    out : pathlib.Path
        Folder of the report.
    """

    quick: bool
    out: Path

    @cached_property
    def recordings(self) -> tuple[Recording, ...]:
        """The frames to measure on, decoded once."""
        return recordings(24 if self.quick else 120)

    def choose(self, quick: int, full: int) -> int:
        """Pick a number of frames or repetitions."""
        return quick if self.quick else full


@dataclass(frozen=True)
class Bound:
    """A promise, and what was measured.

    Parameters
    ----------
    what : str
    limit, measured : float
        It is kept where ``measured <= limit``.
    unit : str
        Written after both.
    """

    what: str
    limit: float
    measured: float
    unit: str = ""

    def row(self) -> list[str]:
        """Cells of the summary table."""
        kept = "yes" if self.measured <= self.limit else "**no**"
        return [
            self.what,
            f"{self.limit:.3g}{self.unit}",
            f"{self.measured:.3g}{self.unit}",
            kept,
        ]


@dataclass(frozen=True)
class Section:
    """A part of the report.

    Parameters
    ----------
    title : str
    body : str
        Markdown.
    bounds : list of Bound
    """

    title: str
    body: str
    bounds: list[Bound] = field(default_factory=list)


def ms(seconds: float) -> str:
    """Write a time in milliseconds to three digits."""
    value = 1e3 * seconds
    return f"{value:.0f}" if value >= 100 else f"{value:.3g}"
