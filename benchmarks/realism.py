"""Made sequences beside the real ones they stand for.

    python -m benchmarks.realism [--docs]

prints the table of docs/scenes, or writes it there.
"""

import argparse

from benchmarks.frames import DATA, ROOT
from benchmarks.report import document
from benchmarks.section import table
from edvo.datasets import open_source
from edvo.synthesis.realism import MODELLED_ON, look_of_source
from edvo.synthesis.sequence import SyntheticSource, make_recipe

PAGE = ROOT / "docs" / "scenes.md"
MARK = "<!-- measured: written by python -m benchmarks.realism --docs -->\n"
FIGURES = {"edges": "edge pixels", "gradient": "mean gradient", "missing": "depth missing"}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--docs", action="store_true", help="put the table into docs/ as well")
    given = parser.parse_args()
    rows = []
    for scene, sequences in MODELLED_ON.items():
        made = look_of_source(SyntheticSource(make_recipe(scene, frames=300)))
        for sequence, figures in sequences.items():
            real = look_of_source(open_source(DATA / sequence))
            ratio = made.over(real)
            for figure in figures:
                values = [show(figure, getattr(look, figure)) for look in (made, real)]
                rows.append(
                    [scene, sequence, FIGURES[figure], *values, f"{getattr(ratio, figure):.2f}"]
                )
    measured = table(["scene", "real sequence", "figure", "made", "real", "ratio"], rows) + "\n"
    print(measured)
    if given.docs:
        document(PAGE.parent, measured, page=PAGE, mark=MARK)


def show(figure: str, value: float) -> str:
    """Write a share in per cent, a gradient in grey levels."""
    return f"{value:.1f}" if figure == "gradient" else f"{value:.2%}"


if __name__ == "__main__":
    main()
