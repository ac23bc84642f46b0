"""Tables in Markdown."""

from collections.abc import Sequence


def markdown_table(
    header: Sequence[str], rows: Sequence[Sequence[str]], right: Sequence[bool] | None = None
) -> str:
    """Lay out a table.

    Parameters
    ----------
    header : sequence of str
        Names of the columns.
    rows : sequence of sequence of str
        Cells.
    right : sequence of bool, optional
        Which columns stand to the right; all but the first by default.

    Returns
    -------
    str
        Lines, without a line break at the end.
    """
    right = [column > 0 for column in range(len(header))] if right is None else right
    lines = [header, ["---:" if to_right else "---" for to_right in right], *rows]
    return "\n".join(f"| {' | '.join(_cell(cell) for cell in line)} |" for line in lines)


def _cell(text: str) -> str:
    return " ".join(text.replace("|", "\\|").split())
