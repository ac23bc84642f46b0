"""A reproduction as one HTML file that needs no other."""

from collections.abc import Sequence
from html import escape

from edvo.experiments.bench import Bench
from edvo.experiments.experiment import Finding, Outcome
from edvo.report.html import document, notes, picture, table
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

_STYLE = """
.paper { color: #555; font-size: .92rem; }
.agrees { background: #d7ecd9; color: #14501c; }
.disagrees { background: #f9d9d3; color: #7c1f0e; }
.open { background: #e8e8e8; color: #444; }
.failed { background: #f9d9d3; padding: .5rem .8rem; border-radius: .3rem; }
"""


def page(stages: Sequence[Shown], bench: Bench) -> str:
    """Write all tables, figures and findings as HTML.

    Parameters
    ----------
    stages : sequence of Shown
        What is shown.
    bench : Bench
        What it was made with.

    Returns
    -------
    str
        The document, its pictures within it.
    """
    links = [("findings", "what holds"), ("sequences", "sequences")]
    links += [(stage.name, stage.name) for stage in stages]
    nav = " ".join(f'<a href="#{escape(to)}">{escape(text)}</a>' for to, text in links)
    parts = [
        f"<h1>{escape(TITLE)}</h1>",
        f'<p class="paper">{escape(PAPER)}.</p>',
        f'<p class="made">{escape(setting_of(bench))}</p>',
        f"<nav>{nav}</nav>",
        _overview(stages),
        _sequences(bench),
        *(_section(stage) for stage in stages),
    ]
    return document(TITLE, parts, style=_STYLE)


def _overview(stages: Sequence[Shown]) -> str:
    findings = findings_of(stages)
    rows = "".join(
        f'<tr><td><a href="#{escape(name)}">{escape(name)}</a></td><td>{escape(f.claim)}</td>'
        f"<td>{_sign(f)}</td><td>{escape(f.sentence)}</td></tr>"
        for name, f in findings
    )
    lost = [stage.name for stage in stages if stage.outcome is None]
    said = f"{tally(finding for _, finding in findings)}."
    if lost:
        said += f" Failed, so that nothing is said of it: {', '.join(lost)}."
    return (
        f'<h2 id="findings">What holds</h2><p>{escape(said)}</p><div class="wide">'
        "<table><thead><tr><th></th><th>the paper</th><th>here</th>"
        f"<th>measured</th></tr></thead><tbody>{rows}</tbody></table></div>"
    )


def _sequences(bench: Bench) -> str:
    rows = table(("sequence", "data"), sequences_of(bench))
    return f'<h2 id="sequences">Sequences</h2>{rows}{notes(bench.notes)}'


def _section(stage: Shown) -> str:
    parts = [f'<section id="{escape(stage.name)}">']
    parts.append(f"<h2>{escape(stage.name)}: {escape(stage.title)}</h2>")
    if stage.paper:
        parts.append(f'<p class="paper">The paper: {escape(stage.paper)}</p>')
    if stage.outcome is None:
        parts.append(f'<p class="failed">Failed: {escape(stage.problem)}</p>')
    else:
        parts.append(_outcome(stage.outcome))
        parts.append(f'<p class="made">Took {stage.seconds:.0f} s.</p>')
    return "\n".join([*parts, "</section>"])


def _outcome(outcome: Outcome) -> str:
    parts = []
    if outcome.findings:
        items = "".join(f"<li>{_sign(f)} {escape(in_words(f))}</li>" for f in outcome.findings)
        parts.append(f"<ul>{items}</ul>")
    parts += [picture(figure.png, figure.caption) for figure in outcome.figures]
    parts += [
        table(t.header, t.rows, title=t.title, numeric=numeric_columns(t.header, t.rows))
        for t in outcome.tables
    ]
    parts.append(notes(outcome.notes))
    return "\n".join(parts)


def _sign(finding: Finding) -> str:
    style = {True: "agrees", False: "disagrees", None: "open"}[finding.holds]
    return f'<span class="sign {style}">{escape(SIGNS[finding.holds])}</span>'
