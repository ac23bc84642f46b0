"""The reader in the documentation is one."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from edvo.datasets import open_source, registry

from .layouts import FRAMES, assert_same, recording, stamp, write_image, write_tum

ROOT = Path(__file__).resolve().parents[2]


def code():
    page = (ROOT / "docs/formats/new.md").read_text()
    (python,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    (toml,) = re.findall(r"```toml\n(.*?)```", page, re.DOTALL)
    return python, toml


class Entry:
    name = "robot"

    def load(self):
        names: dict = {}
        exec(code()[0], names)
        return names["robot"]


def write_robot(folder, of):
    rows = []
    for index in range(FRAMES):
        write_image(folder / f"left/{index}.png", of.colour[index])
        write_image(folder / f"range/{index}.png", of.values(index, 1000))
        rows.append(f"{stamp(index)},{index}.png\n")
    (folder / "frames.csv").write_text("".join(rows))
    return folder


def test_it_is_thirty_lines():
    assert len([line for line in code()[0].splitlines() if line.strip()]) <= 30


def test_the_reader_in_the_documentation_reads(tmp_path, monkeypatch):
    monkeypatch.setattr(registry, "entry_points", lambda group: [Entry()])
    of = recording()
    source = open_source(write_robot(tmp_path / "recording", of))
    assert source.format == "robot"
    assert_same(source, write_tum(tmp_path / "twin", of, scale=1000, truth=False))


def test_it_is_found_in_an_installed_package(tmp_path):
    """As pip leaves it: the package, and beside it the entry point of the page."""
    python, toml = code()
    group, entry = re.fullmatch(
        r'\[project\.entry-points\."([\w.]+)"\]\n(\w+ = ".+")\n', toml
    ).groups()
    assert group == registry.ENTRY_POINTS
    installed = tmp_path / "site"
    (installed / "my_package").mkdir(parents=True)
    (installed / "my_package/__init__.py").write_text("")
    (installed / "my_package/reader.py").write_text(python)
    about = installed / "my_package-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: my_package\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text(f"[{group}]\n" + entry.replace('"', "") + "\n")
    recorded = write_robot(tmp_path / "recording", recording())
    for more in ((), ("--format", "robot")):
        program = (sys.executable, "-c", "from edvo.cli import main; main()")
        done = subprocess.run(
            [*program, "info", recorded, "--json", *more],
            env=os.environ | {"PYTHONPATH": f"{installed}{os.pathsep}{ROOT / 'src'}"},
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        told = json.loads(done.stdout)
        assert (told["format"], told["recognised_by"]) == ("robot", "frames.csv")
        assert (told["frames"], told["camera"]["origin"]) == (FRAMES, "the robot's")


@pytest.mark.parametrize("name", [known.name for known in registry.BUILT_IN])
def test_each_format_has_a_page_with_its_files(name):
    rows = [
        row
        for row in (ROOT / "docs/data.md").read_text().splitlines()
        if row.startswith("| {doc}") and f"`{name}`" in row.split("|")[2]
    ]
    assert len(rows) == 1
    page = ROOT / "docs" / (re.findall(r"\{doc\}`([\w/]+)`", rows[0])[0] + ".md")
    assert "```" in page.read_text()
