"""The report: ``python -m benchmarks.report``, or ``make bench``.

Sections are measured one after the other; the report is written anew after each, so that a run
that is interrupted leaves what it has.
"""

import argparse
import sys
from importlib import import_module
from pathlib import Path

import cv2

from benchmarks.frames import DATA, REAL, ROOT
from benchmarks.machine import Others, describe
from benchmarks.section import Section, Settings, table
from edvo.files import output_folder, write_atomically

SECTIONS = ("speed", "stages", "scaling", "memory", "cores", "startup")
FILE = "benchmarks.md"
PAGE = ROOT / "docs" / "benchmarks.md"
MARK = "<!-- measured: written by python -m benchmarks.report --docs -->\n"


def main() -> None:
    """Measure what is asked for and write it."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.report", description=__doc__)
    parser.add_argument("-o", "--out", type=Path, default=Path("bench"), help="folder to write to")
    parser.add_argument("--quick", action="store_true", help="few frames; figures not to quote")
    parser.add_argument(
        "--only", default=",".join(SECTIONS), help=f"some of {', '.join(SECTIONS)}, by comma"
    )
    parser.add_argument("--docs", action="store_true", help="put the result into docs/ as well")
    given = parser.parse_args()
    names = given.only.split(",")
    for name in names:
        if name not in SECTIONS:
            parser.error(f"no section {name!r}; there are {', '.join(SECTIONS)}")
    if given.docs and (given.quick or names != list(SECTIONS)):
        parser.error("--docs wants all sections, and not a quick run")
    cv2.setNumThreads(1)
    settings = Settings(given.quick, output_folder(given.out))
    others = Others()
    sections: list[Section] = []
    for name in names:
        print(f"measuring: {name}", file=sys.stderr, flush=True)
        sections.append(import_module(f"benchmarks.{name}").measure(settings))
        measured = compose(settings, sections, others)
        write_atomically(settings.out / FILE, f"# Benchmarks of edvo\n\n{measured}")
    print(measured)
    if given.docs:
        document(settings.out, measured)


def compose(settings: Settings, sections: list[Section], others: Others) -> str:
    """Put the report together."""
    machine = describe() | {"other programs meanwhile": f"{others.share()} of the cores"}
    bounds = [bound.row() for section in sections for bound in section.bounds]
    parts = [
        "## Where and on what",
        table(["", ""], [[key, value] for key, value in machine.items()]),
        used(settings),
    ]
    if settings.quick:
        parts.append("**Quick run: too few frames and repetitions for figures to be quoted.**")
    if bounds:
        header = ["promise", "at most", "measured", "kept"]
        parts += ["## What was promised", table(header, bounds)]
    for section in sections:
        parts += [f"## {section.title}", section.body]
    return "\n\n".join(parts) + "\n"


def document(out: Path, measured: str, *, page: Path = PAGE, mark: str = MARK) -> None:
    """Replace what a page in docs/ holds of an earlier run, below its mark, with its pictures."""
    images = output_folder(page.parent / "images")
    for plot in out.glob("*.png"):
        if f"]({plot.name})" in measured:
            measured = measured.replace(f"]({plot.name})", f"](images/{plot.name})")
            write_atomically(images / plot.name, plot.read_bytes())
    before, _, _ = page.read_text(encoding="utf-8").partition(mark)
    write_atomically(page, f"{before.rstrip()}\n\n{mark}\n{measured}")


def used(settings: Settings) -> str:
    """Say which frames were measured on, and which real sequences were not there."""
    rows = [
        [
            recording.name,
            recording.origin,
            f"{recording.camera.width}x{recording.camera.height}",
            str(len(recording.frames)),
        ]
        for recording in settings.recordings
    ]
    missing = [name for name in REAL if not (DATA / name).is_dir()]
    text = "Frames, in memory before anything is timed:\n\n"
    text += table(["sequence", "kind", "size", "frames"], rows)
    if missing:
        text += f"\n\nNot there, so not measured: {', '.join(missing)} (set `EDVO_DATA`)."
    return text


if __name__ == "__main__":
    main()
