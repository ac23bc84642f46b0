"""Cameras whose images are smeared, by the way that they move while a row is exposed.

    python -m benchmarks.smeared [--only office] [--docs]

renders eight clips of three seconds, exposed for up to 25 ms a frame, and tracks each four times,
from two first frames with two seeds: by the preset `default`, which measures the exposure; as if
each image were taken in an instant; and with smeared images blurred by more. Printed is what
`benchmarks.turning` prints. It takes a quarter of an hour, most of it to render.
"""

import argparse

import cv2

from benchmarks.frames import ROOT
from benchmarks.report import document
from benchmarks.turning import Clip, tabulate

PAGE = ROOT / "docs" / "theory" / "smear.md"
MARK = "<!-- measured: written by python -m benchmarks.smeared --docs -->\n"
FRAMES = 90
RULES = {
    "default": (),
    "`motion.exposure=none`": ("motion.exposure=none",),
    "`edges.smear=measured`": ("edges.smear=measured",),
}
CLIPS = (
    Clip("texture_near", 35, 71, 0.0, 0.025),
    Clip("texture_far", 35, 72, 0.0, 0.02),
    Clip("office", 40, 73, 0.02, 0.025),
    Clip("cabinet", 30, 74, 0.0, 0.02),
    Clip("notexture_far", 30, 75, 0.0, 0.02),
    Clip("notexture_near", 35, 76, 0.02, 0.015),
    Clip("stairs", 30, 77, 0.0, 0.02),
    Clip("corridor", 35, 78, 0.0, 0.025),
)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", default="", help="names of scenes, joined by commas")
    parser.add_argument("--docs", action="store_true", help="put the table into docs/ as well")
    given = parser.parse_args()
    cv2.setNumThreads(1)
    measured = tabulate(CLIPS, RULES, given.only, FRAMES)
    if given.docs:
        document(PAGE.parent, measured, page=PAGE, mark=MARK)


if __name__ == "__main__":
    main()
