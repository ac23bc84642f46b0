"""Depth that comes seldom: fewer depth images than colour images, each handed out several times.

    python -m benchmarks.seldom [--docs]

repeats depth images of the real sequences that `EDVO_DATA` names, and of rendered ones, behind
images that go on, without stamps that tell so; and tracks each from two first frames: the preset
`default`, the same that takes them for new, and two others of `edvo compare`. Printed are root mean
squares of the relative pose error over one second (TUM), the share of the frames that have a pose,
and of edvo those that say *tracked*.
"""

import argparse
from dataclasses import replace

import cv2

from benchmarks.defects import contestants, score
from benchmarks.frames import ROOT, Recording, available, recording
from benchmarks.report import document
from benchmarks.section import table

PAGE = ROOT / "docs" / "theory" / "instants.md"
MARK = "<!-- measured: written by python -m benchmarks.seldom --docs -->\n"
RENDERED, FRAMES = ("office", "stairs", "notexture_far"), 130
EVERY = (1, 2, 3, 6)  # frames have a depth image of their own


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--docs", action="store_true", help="put the table into docs/ as well")
    given = parser.parse_args()
    cv2.setNumThreads(1)
    makers = contestants("taken for new", ["motion.repeated_depth=new"])
    rows = []
    for name in dict.fromkeys((*available(), *RENDERED)):
        whole = recording(name, FRAMES)
        for every in EVERY:
            shown = repeated(whole, every)
            how = "1" if every == 1 else f"1 in {every}"
            rows.append([name, how, *(score(shown, make) for make in makers.values())])
            print(" | ".join(rows[-1]), flush=True)
    text = table(["sequence", "depth images", *makers], rows)
    print("\n" + text)
    if given.docs:
        document(PAGE.parent, text + "\n", page=PAGE, mark=MARK)


def repeated(recorded: Recording, every: int) -> Recording:
    """Hand out the depth of every so manieth frame with those that follow it, too."""
    frames = recorded.frames
    shown = (
        replace(frame, depth=frames[i // every * every].depth) for i, frame in enumerate(frames)
    )
    return replace(recorded, frames=tuple(shown))


if __name__ == "__main__":
    main()
