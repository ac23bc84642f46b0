"""A reproduction as Markdown, for the documentation."""

from collections.abc import Sequence

from edvo.experiments.bench import Bench
from edvo.report.markdown_table import markdown_table
from edvo.report.reproduction_words import (
    PAPER,
    SIGNS,
    TITLE,
    Shown,
    findings_of,
    in_words,
    numeric_columns,
    sequences_of,
    setting_of,
    tally,
)


def markdown(stages: Sequence[Shown], bench: Bench) -> str:
    """Write all tables, figures and findings as Markdown.

    Parameters
    ----------
    stages : sequence of Shown
        What is shown.
    bench : Bench
        What it was made with.

    Returns
    -------
    str
        The document; figures are linked where `edvo reproduce` puts them.
    """
    findings = findings_of(stages)
    parts = [
        f"# {TITLE}",
        f"{PAPER}.",
        setting_of(bench),
        "## What holds",
        f"{tally(finding for _, finding in findings)}.",
    ]
    if findings:
        rows = [(name, f.claim, SIGNS[f.holds], f.sentence) for name, f in findings]
        parts.append(_table(("", "the paper", "here", "measured"), rows))
    parts += ["## Sequences", _table(("sequence", "data"), sequences_of(bench))]
    parts += [f"- {note}" for note in bench.notes]
    for stage in stages:
        parts.append(f"## {stage.name}: {stage.title}")
        if stage.paper:
            parts.append(f"The paper: {stage.paper}")
        if stage.outcome is None:
            parts.append(f"**Failed**: {stage.problem}")
            continue
        for figure in stage.outcome.figures:
            parts.append(f"![{figure.caption}]({stage.name}/{figure.name}.png)")
            parts.append(f"*{figure.caption}*")
        for table in stage.outcome.tables:
            parts += [f"**{table.title}**", _table(table.header, table.rows)]
        for finding in stage.outcome.findings:
            parts.append(f"- **{SIGNS[finding.holds]}**: {in_words(finding)}")
        parts += [f"- Note: {note}" for note in stage.outcome.notes]
    return "\n\n".join(parts) + "\n"


def _table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    return markdown_table(header, rows, numeric_columns(header, rows))
