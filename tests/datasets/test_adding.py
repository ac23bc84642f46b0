"""The reader in the documentation is one."""

import re
from pathlib import Path

from edvo.datasets import open_source, registry

from .layouts import FRAMES, assert_same, recording, stamp, write_image, write_tum

ROOT = Path(__file__).resolve().parents[2]


class Entry:
    name = "robot"

    def load(self):
        page = (ROOT / "docs/formats/new.md").read_text()
        (code,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
        assert len(code.strip().splitlines()) <= 40
        names: dict = {}
        exec(code, names)
        return names["robot"]


def test_the_reader_in_the_documentation_reads(tmp_path, monkeypatch):
    monkeypatch.setattr(registry, "entry_points", lambda group: [Entry()])
    of = recording()
    folder = tmp_path / "recording"
    rows = []
    for index in range(FRAMES):
        write_image(folder / f"left/{index}.png", of.colour[index])
        write_image(folder / f"range/{index}.png", of.values(index, 1000))
        rows.append(f"{stamp(index)},{index}.png\n")
    (folder / "frames.csv").write_text("".join(rows))
    source = open_source(folder)
    assert source.format == "robot"
    assert_same(source, write_tum(tmp_path / "twin", of, scale=1000, truth=False))


def test_each_format_has_a_page():
    pages = "".join(page.read_text() for page in sorted((ROOT / "docs/formats").glob("*.md")))
    table = (ROOT / "docs/data.md").read_text()
    for known in registry.BUILT_IN:
        assert f"`{known.name}`" in table, known.name
    assert "{doc}" in pages
