"""Parts of pages that need no other file: style, tables, pictures within the page."""

from base64 import b64encode
from collections.abc import Sequence
from html import escape

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
figcaption, .note, .made { color: #555; font-size: .92rem; }
.sign { display: inline-block; border-radius: .3rem; padding: 0 .5rem; white-space: nowrap;
  font-size: .85rem; font-weight: 600; }
li { margin: .35rem 0; }
"""


def document(title: str, body: Sequence[str], *, style: str = "") -> str:
    """Put a page together.

    Parameters
    ----------
    title : str
        Of the page, as text.
    body : sequence of str
        HTML.
    style : str
        Rules beyond those that all pages have.

    Returns
    -------
    str
        The document.
    """
    head = [
        "<!DOCTYPE html>",
        '<html lang="en">',
        f'<head><meta charset="utf-8"><title>{escape(title)}</title>',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<style>{_STYLE}{style}</style></head>",
        "<body>",
    ]
    return "\n".join([*head, *body, "</body></html>"]) + "\n"


def picture(image: bytes, caption: str, *, kind: str = "png") -> str:
    """Show a picture that lies within the page, with words below.

    Parameters
    ----------
    image : bytes
        The file.
    caption : str
        As text.
    kind : str
        ``png`` or ``jpeg``.

    Returns
    -------
    str
        HTML.
    """
    data, words = b64encode(image).decode(), escape(caption)
    return (
        f'<figure><img alt="{words}" src="data:image/{kind};base64,{data}">'
        f"<figcaption>{words}</figcaption></figure>"
    )


def table(
    header: Sequence[str],
    rows: Sequence[Sequence[str]],
    *,
    title: str = "",
    numeric: Sequence[bool] | None = None,
) -> str:
    """Lay out a table.

    Parameters
    ----------
    header : sequence of str
        Text above each column.
    rows : sequence of sequence of str
        Text of the cells; bold between double asterisks.
    title : str
        Above all.
    numeric : sequence of bool, optional
        Which columns are put to the right.

    Returns
    -------
    str
        HTML.
    """
    sides = [False] * len(header) if numeric is None else numeric
    classes = [' class="n"' if side else "" for side in sides]
    head = "".join(
        f"<th{kind}>{escape(cell)}</th>" for kind, cell in zip(classes, header, strict=True)
    )
    lines = [
        "".join(f"<td{kind}>{_cell(cell)}</td>" for kind, cell in zip(classes, row, strict=True))
        for row in rows
    ]
    body = "".join(f"<tr>{line}</tr>" for line in lines)
    caption = f"<caption>{escape(title)}</caption>" if title else ""
    return (
        f'<div class="wide"><table>{caption}'
        f"<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>"
    )


def notes(lines: Sequence[str]) -> str:
    """List what is worth knowing.

    Parameters
    ----------
    lines : sequence of str
        Text.

    Returns
    -------
    str
        HTML; empty where there is nothing.
    """
    items = "".join(f"<li>{escape(line)}</li>" for line in lines)
    return f'<ul class="note">{items}</ul>' if items else ""


def _cell(text: str) -> str:
    if len(text) > 4 and text.startswith("**") and text.endswith("**"):
        return f"<strong>{escape(text[2:-2])}</strong>"
    return escape(text)
