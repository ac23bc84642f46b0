"""What the page and the summary of a reproduction say alike."""

from collections.abc import Iterable, Sequence
from typing import Protocol

from edvo.experiments.bench import Bench
from edvo.experiments.experiment import Finding, Outcome

TITLE = "The paper's tables and figures, made again"
PAPER = (
    "Kim, Kim, Lee and Kim: Edge-based Robust RGB-D Visual Odometry Using 2-D Edge Divergence "
    "Minimization, IROS 2018"
)
SIGNS = {True: "agrees", False: "disagrees", None: "cannot say"}
"""How a finding stands to the paper, in a word or two."""

_NO_NUMBERS = ("", "-", "x", "x before")
_LONGEST = 20


class Shown(Protocol):
    """What is shown of a stage."""

    @property
    def name(self) -> str:
        """Of the experiment."""
        ...

    @property
    def title(self) -> str:
        """Of the experiment."""
        ...

    @property
    def paper(self) -> str:
        """What the paper shows."""
        ...

    @property
    def outcome(self) -> Outcome | None:
        """What came out."""
        ...

    @property
    def problem(self) -> str:
        """Why nothing did."""
        ...

    @property
    def seconds(self) -> float:
        """Time it took."""
        ...


def in_words(finding: Finding) -> str:
    """Say a finding: the claim, and what was measured.

    Parameters
    ----------
    finding : Finding
        What to say.

    Returns
    -------
    str
        Two sentences.
    """
    return f"{finding.claim.rstrip('.')}. {finding.sentence}"


def findings_of(stages: Sequence[Shown]) -> list[tuple[str, Finding]]:
    """Collect all findings.

    Parameters
    ----------
    stages : sequence of Shown
        Stages.

    Returns
    -------
    list of (str, Finding)
        With the name of the experiment.
    """
    return [(s.name, f) for s in stages if s.outcome is not None for f in s.outcome.findings]


def tally(findings: Iterable[Finding]) -> str:
    """Count findings.

    Parameters
    ----------
    findings : iterable of Finding
        Findings.

    Returns
    -------
    str
        Such as ``3 claims: 2 agree, 1 disagrees``.
    """
    held = [finding.holds for finding in findings]
    parts = []
    for value, one, many in (
        (True, "agrees", "agree"),
        (False, "disagrees", "disagree"),
        (None, "cannot be decided", "cannot be decided"),
    ):
        count = held.count(value)
        if count:
            parts.append(f"{count} {one if count == 1 else many}")
    said = f"{len(held)} claim{'' if len(held) == 1 else 's'}"
    return f"{said}: {', '.join(parts)}" if parts else said


def setting_of(bench: Bench) -> str:
    """Say how it was made.

    Parameters
    ----------
    bench : Bench
        What it was made with.

    Returns
    -------
    str
        A sentence or two.
    """
    settings = bench.settings()
    how = "a quick run: few frames, figures not to quote" if bench.quick else "a full run"
    return (
        f"Made by edvo {settings['edvo']} with OpenCV {settings['opencv']}, seed {bench.seed}; "
        f"{how}."
    )


def sequences_of(bench: Bench) -> list[tuple[str, str]]:
    """Say what each sequence really is.

    Parameters
    ----------
    bench : Bench
        What gave them.

    Returns
    -------
    list of (str, str)
        Name and label.
    """
    return [(name, bench.sequence(name).label) for name in bench.names]


def numeric_columns(header: Sequence[str], rows: Sequence[Sequence[str]]) -> list[bool]:
    """Say which columns hold numbers, to be put below each other.

    Parameters
    ----------
    header : sequence of str
        Names of the columns.
    rows : sequence of sequence of str
        Cells.

    Returns
    -------
    list of bool
        For each column.
    """
    return [
        bool(rows) and all(_is_number(row[column]) for row in rows) for column in range(len(header))
    ]


def _is_number(cell: str) -> bool:
    text = cell.strip("* ")
    return text in _NO_NUMBERS or (len(text) <= _LONGEST and text[:1] in "0123456789-+.<>~")
