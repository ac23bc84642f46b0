"""Stages that resume, none lost by another; one page that needs no other file."""

import csv
import json
from base64 import b64decode
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from edvo.errors import DatasetError, OutputError
from edvo.experiments.bench import Bench
from edvo.experiments.experiment import Experiment, Figure, Finding, Outcome, Table
from edvo.report import outcomes
from edvo.report.outcomes import OUTCOME, read_outcome, table_csv, write_outcome
from edvo.report.reproduction import (
    FAILURE,
    PAGE,
    SUMMARY,
    Stage,
    completed,
    run_stages,
    write_pages,
)
from edvo.report.reproduction_words import numeric_columns, tally

PNG = b64decode(
    "iVBORw0KGgoAAAANSUhEUgAAAAEAAAABCAYAAAAfFcSJAAAADUlEQVR42mNkYPhfDwAChwGA60e6kgAAAABJRU5ErkJggg=="
)


def outcome(name: str, **more: Any) -> Outcome:
    table = Table(
        "numbers",
        "Numbers & <more>",
        ("sequence", "error"),
        [("fr3 <b>", "**0.012**"), ("fr1", "x")],
        [{"sequence": "fr3", "error_m": 0.0123}, {"sequence": "fr1", "error_m": None}],
    )
    findings = [
        Finding("It <holds>", True, "It does: 1 < 2."),
        Finding("It does not", False, "It does not."),
        Finding("Who knows", None, "Nobody."),
    ]
    kept = {"tables": [table], "figures": [Figure("plot", 'What "is" seen', PNG)]}
    return Outcome(
        name, f"{name} again", **{**kept, "findings": findings, "notes": ("A & B",), **more}
    )


class Fakes(dict[str, Experiment]):
    """Experiments that count how often they are run."""

    def __init__(self) -> None:
        self.calls: list[str] = []
        for name in ("one", "two", "three"):
            self.set(name, lambda bench, name=name: outcome(name))

    def set(self, name: str, run: Callable[[Bench], Outcome]) -> None:
        def counted(bench: Bench) -> Outcome:
            self.calls.append(name)
            return run(bench)

        self[name] = Experiment(name, f"title of {name}", f"what {name} shows", counted)


@pytest.fixture
def fakes() -> Fakes:
    return Fakes()


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    return Bench(tmp_path, quick=True, stand_in_frames=2)


def run(fakes: Fakes, bench: Bench, names: str = "one two three", **more: Any) -> list[Stage]:
    return list(run_stages(names.split(), bench, bench.folder, fakes, **more))


def test_each_writes_its_files(fakes: Fakes, bench: Bench) -> None:
    begun: list[str] = []
    stages = run(fakes, bench, on_begin=begun.append)
    assert begun == ["one", "two", "three"]
    assert [stage.outcome is not None and not stage.resumed for stage in stages] == [True] * 3
    folder = bench.folder / "two"
    assert {file.name for file in folder.iterdir()} == {"numbers.csv", "plot.png", OUTCOME}
    assert (folder / "plot.png").read_bytes() == PNG
    rows = list(csv.DictReader((folder / "numbers.csv").open()))
    assert rows == [{"sequence": "fr3", "error_m": "0.0123"}, {"sequence": "fr1", "error_m": ""}]


def test_a_second_run_does_nothing_again(fakes: Fakes, bench: Bench) -> None:
    first = run(fakes, bench)
    second = run(fakes, bench)
    assert fakes.calls == ["one", "two", "three"]
    assert all(stage.resumed for stage in second)
    assert [stage.outcome for stage in first] == [stage.outcome for stage in second]


def test_force(fakes: Fakes, bench: Bench) -> None:
    run(fakes, bench)
    run(fakes, bench, "two", force=True)
    assert fakes.calls == ["one", "two", "three", "two"]


def test_other_settings_are_run_again(fakes: Fakes, bench: Bench) -> None:
    run(fakes, bench, "one")
    other = Bench(bench.folder, quick=True, stand_in_frames=2, seed=1)
    run(fakes, other, "one")
    assert fakes.calls == ["one", "one"]
    assert completed(bench, bench.folder, fakes) == []
    assert [stage.name for stage in completed(other, bench.folder, fakes)] == ["one"]


@pytest.mark.parametrize("damage", ["no picture", "half a file", "not what it was"])
def test_damage_is_mended(fakes: Fakes, bench: Bench, damage: str) -> None:
    run(fakes, bench, "one")
    place = bench.folder / "one"
    if damage == "no picture":
        (place / "plot.png").unlink()
    elif damage == "half a file":
        (place / OUTCOME).write_text((place / OUTCOME).read_text()[:100])
    else:
        (place / OUTCOME).write_text("[]")
    assert run(fakes, bench, "one")[0].resumed is False
    assert run(fakes, bench, "one")[0].resumed is True


def test_one_that_fails_loses_no_other(fakes: Fakes, bench: Bench) -> None:
    def fail(bench: Bench) -> Outcome:
        raise ValueError("two lines\nof trouble")

    def refuse(bench: Bench) -> Outcome:
        raise DatasetError("no such sequence; give one")

    fakes.set("one", refuse)
    fakes.set("two", fail)
    stages = run(fakes, bench)
    assert [stage.problem for stage in stages] == [
        "no such sequence; give one",
        "ValueError: two lines of trouble",
        "",
    ]
    assert "Traceback" in (bench.folder / "two" / FAILURE).read_text()
    assert not (bench.folder / "two" / OUTCOME).exists()
    fakes.set("two", lambda bench: outcome("two"))
    assert [stage.resumed for stage in run(fakes, bench, "two three")] == [False, True]
    assert not (bench.folder / "two" / FAILURE).exists()


def test_one_that_is_not_there_fails_like_any(bench: Bench) -> None:
    assert "KeyError" in run(Fakes(), bench, "nine")[0].problem


def test_interrupted(fakes: Fakes, bench: Bench) -> None:
    def interrupt(bench: Bench) -> Outcome:
        raise KeyboardInterrupt

    fakes.set("two", interrupt)
    stages = run_stages(["one", "two", "three"], bench, bench.folder, fakes)
    assert next(stages).name == "one"
    with pytest.raises(KeyboardInterrupt):
        next(stages)
    fakes.set("two", lambda bench: outcome("two"))
    assert [stage.resumed for stage in run(fakes, bench)] == [True, False, False]


def test_half_written_is_not_complete(
    fakes: Fakes, bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    run(fakes, bench, "one")
    write = outcomes.write_atomically

    def full(path: Path, content: bytes | str) -> None:
        if path.suffix == ".png":
            raise OutputError(f"cannot write {path}: no space left on device")
        write(path, content)

    monkeypatch.setattr(outcomes, "write_atomically", full)
    stage = run(fakes, bench, "one", force=True)[0]
    assert stage.outcome is None
    assert "no space left" in stage.problem
    monkeypatch.undo()
    # The older outcome is gone with it: its numbers may be replaced already.
    assert run(fakes, bench, "one")[0].resumed is False


def test_files_of_an_older_outcome_go(bench: Bench) -> None:
    folder = bench.folder / "one"
    write_outcome(outcome("one"), folder, {}, 1.0)
    (folder / "mine.png").write_bytes(PNG)
    write_outcome(outcome("one", figures=[], tables=[]), folder, {}, 1.0)
    assert {file.name for file in folder.iterdir()} == {OUTCOME, "mine.png"}


def test_numpy_numbers_are_kept(tmp_path: Path) -> None:
    table = Table("t", "t", ("a",), [("1",)], [{"a": np.float64(1.5), "b": np.int64(2)}])
    finding = Finding("c", np.bool_(True), "s")
    write_outcome(outcome("one", tables=[table], findings=[finding]), tmp_path, {}, 1.0)
    kept = read_outcome(tmp_path, {})
    assert kept is not None
    assert kept.outcome.tables[0].records == [{"a": 1.5, "b": 2}]
    assert kept.outcome.findings[0].holds is True


def test_csv_without_records_is_what_people_read() -> None:
    table = Table("t", "t", ("a", "b"), [("1,5", "x")])
    assert table_csv(table) == 'a,b\n"1,5",x\n'


def test_rows_must_fit_the_header() -> None:
    with pytest.raises(ValueError, match="table t: 1 cells"):
        Table("t", "t", ("a", "b"), [("1",)])


def test_tally() -> None:
    findings = outcome("one").findings
    assert tally(findings) == "3 claims: 1 agrees, 1 disagrees, 1 cannot be decided"
    assert tally([findings[0]] * 2) == "2 claims: 2 agree"
    assert tally([]) == "0 claims"


def test_numbers_are_told_from_words() -> None:
    rows = [("fr3", "**0.01**", "x", "no poses"), ("fr1", "-", "1.2 %", "12 of 13")]
    assert numeric_columns(("a", "b", "c", "d"), rows) == [False, True, True, False]


class Reader(HTMLParser):
    """Reads a page and keeps what matters of it."""

    VOID = ("meta", "img")

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.references: list[str] = []
        self.ids: list[str] = []
        self.text: list[str] = []
        self.tags: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        if tag not in self.VOID:
            self.open.append(tag)
        for key, value in attrs:
            if key in ("href", "src", "srcset", "action", "data", "poster"):
                self.references.append(value or "")
            if key == "id":
                self.ids.append(value or "")

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text.append(data)


def read_page(bench: Bench, stages: list[Stage]) -> tuple[Reader, str]:
    write_pages(stages, bench, bench.folder)
    html = (bench.folder / PAGE).read_text()
    reader = Reader()
    reader.feed(html)
    reader.close()
    assert reader.open == []
    return reader, html


def test_page_needs_no_other_file(fakes: Fakes, bench: Bench) -> None:
    reader, html = read_page(bench, run(fakes, bench))
    assert html.startswith("<!DOCTYPE html>")
    pictures = [r for r in reader.references if r.startswith("data:")]
    links = [r for r in reader.references if not r.startswith("data:")]
    assert len(pictures) == 3
    assert b64decode(pictures[0].removeprefix("data:image/png;base64,")) == PNG
    assert all(link.startswith("#") and link[1:] in reader.ids for link in links)
    for outside in ("http:", "https:", "url(", "@import", "<script", "<link"):
        assert outside not in html


def test_page_says_it_all(fakes: Fakes, bench: Bench) -> None:
    def fail(bench: Bench) -> Outcome:
        raise DatasetError("nothing <there>")

    fakes.set("two", fail)
    reader, html = read_page(bench, run(fakes, bench))
    text = "".join(reader.text)
    assert "one: title of one" in text
    assert "The paper: what one shows" in text
    assert "Failed: nothing <there>" in text
    assert "6 claims: 2 agree, 2 disagree, 2 cannot be decided" in text
    assert "nothing is said of it: two" in text
    assert "It <holds>" in text
    assert "It does: 1 < 2." in text
    assert "Numbers & <more>" in text
    assert "stand-in: synthetic texture_far, 2 frames" in text
    assert "a quick run" in text
    assert "<strong>0.012</strong>" in html
    assert {"one", "two", "three", "findings", "sequences"} <= set(reader.ids)
    assert reader.tags.count("img") == 2


def test_summary_is_markdown(fakes: Fakes, bench: Bench) -> None:
    write_pages(run(fakes, bench), bench, bench.folder)
    text = (bench.folder / SUMMARY).read_text()
    assert text.startswith("# ")
    assert '![What "is" seen](two/plot.png)' in text
    assert (bench.folder / "two" / "plot.png").exists()
    assert "| fr3 <b> | **0.012** |" in text
    assert "- **disagrees**: It does not. It does not." in text
    lines = [line for line in text.splitlines() if line.startswith("|")]
    assert all(line.endswith("|") for line in lines)


def test_settings_are_written_with_the_outcome(fakes: Fakes, bench: Bench) -> None:
    run(fakes, bench, "one")
    kept = json.loads((bench.folder / "one" / OUTCOME).read_text())
    assert kept["settings"] == bench.settings()
