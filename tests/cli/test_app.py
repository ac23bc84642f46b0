"""The command line as a whole: start-up, help, exit statuses, pipes."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from edvo import __version__
from edvo.cli.terminal import table

from .conftest import Command

HEAVY = {"numpy", "cv2", "numba", "matplotlib", "scipy", "rich"}
COMMANDS = ["run", "info", "evaluate", "demo", "synth", "relight", "warmup"]
INSTALLED = Path(sys.executable).with_name("edvo")


@pytest.mark.parametrize(
    "arguments", [["--help"], ["--version"], ["run", "--help"], ["relight", "--help"]]
)
def test_starts_without_heavy_imports(arguments: list[str]) -> None:
    code = (
        "import sys\nfrom edvo.cli import main\ntry:\n    main()\n"
        f"finally:\n    print(sorted({HEAVY!r} & set(sys.modules)), file=sys.stderr)"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments], capture_output=True, text=True, check=True
    )
    assert done.stderr == "[]\n"


@pytest.mark.skipif(not INSTALLED.exists(), reason="edvo is not installed beside this Python")
def test_installed_command() -> None:
    done = subprocess.run([INSTALLED, "--version"], capture_output=True, text=True, check=True)
    assert done.stdout == f"edvo {__version__}\n"
    done = subprocess.run(
        [INSTALLED, "info", "nowhere"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1


def test_runs_as_a_module() -> None:
    command = [sys.executable, "-m", "edvo"]
    done = subprocess.run([*command, "--version"], capture_output=True, text=True, check=True)
    assert done.stdout == f"edvo {__version__}\n"
    done = subprocess.run([*command, "fly"], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "edvo [OPTIONS] COMMAND" in done.stderr  # no name of a file


def test_help_lists_the_commands(edvo: Command) -> None:
    done = edvo("--help")
    assert done.status == 0
    for command in COMMANDS:
        assert command in done.out


@pytest.mark.parametrize("command", COMMANDS)
def test_each_command_has_help(edvo: Command, command: str) -> None:
    done = edvo(command, "--help")
    assert done.status == 0
    assert f"edvo {command}" in done.out


@pytest.mark.parametrize(
    "arguments",
    [["fly"], ["run"], ["run", "x", "-o", "y", "--stride", "0"], ["run", "x", "-o", "y", "--fast"]],
)
def test_wrong_usage_exits_with_2(edvo: Command, arguments: list[str]) -> None:
    done = edvo(*arguments)
    assert done.status == 2
    assert "Usage" in done.err


def test_reader_that_leaves_is_no_news(whole_sequence: Path) -> None:
    code = "from edvo.cli import main; main()"
    reader, writer = os.pipe()
    os.close(reader)  # before anything is written, however busy the machine is
    done = subprocess.run(
        [sys.executable, "-c", code, "info", str(whole_sequence)],
        stdout=writer,
        stderr=subprocess.PIPE,
        text=True,
        check=False,
    )
    os.close(writer)
    assert done.stderr.replace("edvo: compiling for about a minute, once\n", "") == ""
    assert done.returncode != 0


def test_table_lines_up() -> None:
    assert table(["", "a"], [["x", "1.0"], ["long", "22.0"]]).splitlines() == [
        "         a",
        "----  ----",
        "x      1.0",
        "long  22.0",
    ]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full")
@pytest.mark.parametrize("command", ["info", "run", "help"])
def test_a_full_output_is_told_in_a_line(
    whole_sequence: Path, tmp_path: Path, command: str
) -> None:
    arguments = {
        "info": ["info", str(whole_sequence)],
        "run": ["run", str(whole_sequence), "-o", str(tmp_path), "--max-frames", "3"],
        "help": ["--help"],
    }[command]
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "edvo", *arguments],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
        )
    assert done.returncode == 1
    last = done.stderr.splitlines()[-1]
    assert last.startswith("edvo: cannot print: No space left on device; ")
    assert "Traceback" not in done.stderr
    assert (tmp_path / "summary.json").exists() == (command == "run")


@pytest.mark.skipif(os.name != "posix", reason="no shell that closes a stream")
@pytest.mark.parametrize("closed", ["2>&-", ">&-", "<&- >&- 2>&-"])
def test_a_closed_stream_is_as_good_as_none(
    whole_sequence: Path, tmp_path: Path, closed: str
) -> None:
    command = [sys.executable, "-m", "edvo"]
    track = ["run", str(whole_sequence), "-o", str(tmp_path), "--max-frames", "3"]
    for arguments, status in ((track, 0), (["info", "nowhere"], 1), (["fly"], 2)):
        shell = ["sh", "-c", f'"$@" {closed}', "sh", *command, *arguments]
        done = subprocess.run(shell, capture_output=True, text=True, check=False)
        assert done.returncode == status, done.stderr
        assert "Traceback" not in done.stderr
    assert (tmp_path / "trajectory.txt").read_text().count("\n") == 4
