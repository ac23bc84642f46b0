"""A reproduction as one HTML file that needs no other."""

from base64 import b64encode
from collections.abc import Sequence
from html import escape

from edvo.experiments.bench import Bench
from edvo.experiments.experiment import Figure, Finding, Outcome, Table
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
:root { color-scheme: light; }
body { font: 16px/1.5 system-ui, sans-serif; color: #222; background: #fff;
  max-width: 70rem; margin: 0 auto; padding: 1rem 1.5rem 4rem; }
h1 { margin-bottom: 0; } h2 { margin-top: 3rem; border-bottom: 2px solid #eee; }
nav a { margin-right: .9rem; } a { color: #0b5394; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; font-size: .86rem; margin: .4rem 0 1.2rem;
  font-variant-numeric: tabular-nums; }
caption { text-align: left; font-weight: 600; padding: .3rem 0; }
th, td { border-bottom: 1px solid #e4e4e4; padding: .25rem .6rem; text-align: left;
  vertical-align: top; }
.n { text-align: right; }
thead th { border-bottom: 2px solid #999; vertical-align: bottom; }
figure { margin: 1.2rem 0; } figure img { max-width: 100%; height: auto; }
figcaption, .paper, .note, .made { color: #555; font-size: .92rem; }
.sign { display: inline-block; border-radius: .3rem; padding: 0 .5rem; white-space: nowrap;
  font-size: .85rem; font-weight: 600; }
.agrees { background: #d7ecd9; color: #14501c; }
.disagrees { background: #f9d9d3; color: #7c1f0e; }
.open { background: #e8e8e8; color: #444; }
.failed { background: #f9d9d3; padding: .5rem .8rem; border-radius: .3rem; }
li { margin: .35rem 0; }
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
        "<!DOCTYPE html>",
        '<html lang="en">',
        f'<head><meta charset="utf-8"><title>{escape(TITLE)}</title>',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<style>{_STYLE}</style></head>",
        "<body>",
        f"<h1>{escape(TITLE)}</h1>",
        f'<p class="paper">{escape(PAPER)}.</p>',
        f'<p class="made">{escape(setting_of(bench))}</p>',
        f"<nav>{nav}</nav>",
        _overview(stages),
        _sequences(bench),
        *(_section(stage) for stage in stages),
        "</body></html>",
    ]
    return "\n".join(parts) + "\n"


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
    rows = "".join(
        f"<tr><td>{escape(name)}</td><td>{escape(label)}</td></tr>"
        for name, label in sequences_of(bench)
    )
    return (
        '<h2 id="sequences">Sequences</h2><table><thead><tr><th>sequence</th>'
        f"<th>data</th></tr></thead><tbody>{rows}</tbody></table>{_notes(bench.notes)}"
    )


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
    parts += [_figure(figure) for figure in outcome.figures]
    parts += [_table(table) for table in outcome.tables]
    parts.append(_notes(outcome.notes))
    return "\n".join(parts)


def _figure(figure: Figure) -> str:
    data = b64encode(figure.png).decode()
    caption = escape(figure.caption)
    return (
        f'<figure><img alt="{caption}" src="data:image/png;base64,{data}">'
        f"<figcaption>{caption}</figcaption></figure>"
    )


def _table(table: Table) -> str:
    classes = [' class="n"' if n else "" for n in numeric_columns(table.header, table.rows)]
    head = "".join(
        f"<th{kind}>{escape(cell)}</th>" for kind, cell in zip(classes, table.header, strict=True)
    )
    lines = [
        "".join(f"<td{kind}>{_cell(cell)}</td>" for kind, cell in zip(classes, row, strict=True))
        for row in table.rows
    ]
    body = "".join(f"<tr>{line}</tr>" for line in lines)
    return (
        f'<div class="wide"><table><caption>{escape(table.title)}</caption>'
        f"<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>"
    )


def _cell(text: str) -> str:
    if len(text) > 4 and text.startswith("**") and text.endswith("**"):
        return f"<strong>{escape(text[2:-2])}</strong>"
    return escape(text)


def _notes(notes: Sequence[str]) -> str:
    items = "".join(f"<li>{escape(note)}</li>" for note in notes)
    return f'<ul class="note">{items}</ul>' if items else ""


def _sign(finding: Finding) -> str:
    style = {True: "agrees", False: "disagrees", None: "open"}[finding.holds]
    return f'<span class="sign {style}">{escape(SIGNS[finding.holds])}</span>'
