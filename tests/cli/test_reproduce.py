"""`edvo reproduce` as a user calls it."""

import json
import signal
from contextlib import nullcontext
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from edvo.cli import reproduce as module
from edvo.experiments.bench import Bench
from edvo.experiments.experiment import Experiment, Finding, Outcome, Table
from edvo.experiments.registry import NAMES
from edvo.synthesis.sequence import DEFAULT_CAMERA

from .conftest import Command, make_sequence


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let synthetic sequences be small."""
    camera = DEFAULT_CAMERA.scaled(0.25)
    monkeypatch.setattr(module, "Bench", partial(Bench, stand_in_frames=40, camera=camera))
    monkeypatch.delenv("EDVO_DATA", raising=False)


def fake(name: str, run: Any = None) -> Experiment:
    table = Table("numbers", "Numbers", ("a",), [("1",)])
    finding = Finding("It holds", True, "It does.")

    def made(bench: Bench) -> Outcome:
        bench.advance("half way")
        return Outcome(name, name, [table], [], [finding])

    return Experiment(name, f"title of {name}", "", run or made)


@pytest.fixture
def fakes(small: None, monkeypatch: pytest.MonkeyPatch) -> dict[str, Experiment]:
    """Put experiments that do nothing in place of all others."""
    experiments = {name: fake(name) for name in NAMES}
    monkeypatch.setattr(module, "EXPERIMENTS", experiments)
    monkeypatch.setattr(module, "compile_now", lambda *configs: None)
    monkeypatch.setattr(module, "renderer_compiling_aside", nullcontext)
    return experiments


def test_a_figure_for_real(edvo: Command, small: None, tmp_path: Path) -> None:
    data = tmp_path / "data"
    make_sequence(data / "rgbd_dataset_freiburg3_structure_notexture_far", frames=36)
    out = tmp_path / "out"
    done = edvo("reproduce", "fig11", "--quick", "-o", out, "--data", data)
    assert done.status == 0, done.err
    assert "fig11: The sequences" in done.out
    assert "disagrees: Images one second apart" in done.out
    assert f"wrote {out / 'index.html'}" in done.out
    assert (out / "fig11" / "contact_sheet.png").exists()
    table = (out / "fig11" / "sequences.csv").read_text()
    assert 'fr3/structure_notexture_far,"real, 36 frames"' in table
    assert "stand-in: synthetic cabinet, 40 frames" in table
    page = (out / "index.html").read_text()
    assert "data:image/png;base64," in page
    again = edvo("reproduce", "fig11", "--quick", "-o", out, "--data", data)
    assert "complete already" in again.out
    assert (out / "fig11" / "sequences.csv").read_text() == table


def test_all(edvo: Command, fakes: dict[str, Experiment], tmp_path: Path) -> None:
    done = edvo("reproduce", "all", "--quick", "-o", tmp_path)
    assert done.status == 0, done.err
    assert [line.split(":")[0] for line in done.out.splitlines() if "title of" in line] == [*NAMES]
    assert {file.name for file in tmp_path.iterdir()} == {*NAMES, "index.html", "summary.md"}


def test_several_in_the_papers_order_each_once(
    edvo: Command, fakes: dict[str, Experiment], tmp_path: Path
) -> None:
    done = edvo("reproduce", "table2", "fig3", "table2", "-o", tmp_path)
    assert [line.split(":")[0] for line in done.out.splitlines() if "title of" in line] == [
        "fig3",
        "table2",
    ]


def test_page_keeps_what_was_made_before(
    edvo: Command, fakes: dict[str, Experiment], tmp_path: Path
) -> None:
    edvo("reproduce", "fig3", "-o", tmp_path)
    edvo("reproduce", "table2", "-o", tmp_path)
    page = (tmp_path / "index.html").read_text()
    assert 'id="fig3"' in page
    assert 'id="table2"' in page
    assert 'id="fig8"' not in page


def test_failure(edvo: Command, fakes: dict[str, Experiment], tmp_path: Path) -> None:
    def fail(bench: Bench) -> Outcome:
        raise ValueError("no sense in that")

    fakes["fig6"] = fake("fig6", fail)
    done = edvo("reproduce", "fig3", "fig6", "fig9", "-o", tmp_path)
    assert done.status == 1
    assert "fig6 failed: ValueError: no sense in that" in done.err
    assert f"failed: fig6; {tmp_path / 'fig6' / 'failure.txt'}" in done.err
    assert "Traceback" not in done.err
    page = (tmp_path / "index.html").read_text()
    assert "no sense in that" in page
    assert 'id="fig9"' in page


def test_interrupt(edvo: Command, fakes: dict[str, Experiment], tmp_path: Path) -> None:
    def interrupt(bench: Bench) -> Outcome:
        signal.raise_signal(signal.SIGINT)
        raise AssertionError("not interrupted")

    def fail(bench: Bench) -> Outcome:
        raise ValueError("no sense in that")

    fakes["fig3"] = fake("fig3", fail)
    fakes["fig6"] = fake("fig6", interrupt)
    done = edvo("reproduce", "all", "-o", tmp_path)
    assert done.status == 130
    before = NAMES.index("fig6") - 1  # fig3 is not complete: it failed
    assert f"interrupted; {before} of {len(NAMES)} are complete" in done.err
    assert json.loads((tmp_path / "fig5" / "outcome.json").read_text())["name"] == "fig5"
    assert 'id="fig5"' in (tmp_path / "index.html").read_text()
    fakes["fig3"] = fake("fig3")
    fakes["fig6"] = fake("fig6")
    rest = edvo("reproduce", "all", "-o", tmp_path)
    assert rest.status == 0
    assert rest.out.count("complete already") == before


def test_unknown_name(edvo: Command, tmp_path: Path) -> None:
    done = edvo("reproduce", "fig4", "-o", tmp_path / "out")
    assert done.status == 2
    said = " ".join(done.err.replace("│", " ").split())
    assert "there is no 'fig4'; choose of fig2, fig3" in said
    assert not (tmp_path / "out").exists()


def test_no_name(edvo: Command) -> None:
    assert edvo("reproduce").status == 2


def test_no_data_folder(edvo: Command, small: None, tmp_path: Path) -> None:
    done = edvo("reproduce", "fig2", "-o", tmp_path / "out", "--data", tmp_path / "nowhere")
    assert done.status == 1
    assert done.err.startswith(f"edvo: {tmp_path / 'nowhere'}: no such folder")
    assert not (tmp_path / "out").exists()


def test_data_folder_from_the_environment(
    edvo: Command,
    fakes: dict[str, Experiment],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    make_sequence(tmp_path / "data" / "tum_fr3_cabinet", frames=4)
    monkeypatch.setenv("EDVO_DATA", str(tmp_path / "data"))
    done = edvo("reproduce", "fig3", "-o", tmp_path / "out")
    assert done.status == 0, done.err
    assert "real, 4 frames" in (tmp_path / "out" / "index.html").read_text()
    monkeypatch.setenv("EDVO_DATA", str(tmp_path / "none"))
    assert edvo("reproduce", "fig3", "-o", tmp_path / "out").status == 1


def test_folder_in_the_way(edvo: Command, fakes: dict[str, Experiment], tmp_path: Path) -> None:
    (tmp_path / "out").write_text("a file")
    done = edvo("reproduce", "fig3", "-o", tmp_path / "out")
    assert done.status == 1
    assert done.err.startswith("edvo: cannot write into")


def test_help_lists_what_there_is(edvo: Command) -> None:
    said = " ".join(edvo("reproduce", "--help").out.replace("│", " ").split())
    for name in (*NAMES, "all", "EDVO_DATA"):
        assert name in said
