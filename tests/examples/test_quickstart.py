"""The notebook runs from its first cell to its last, and says what it should."""

import re

import pytest

from . import stubs


def test_runs_and_is_kept_without_output(tmp_path: object, monkeypatch: pytest.MonkeyPatch) -> None:
    nbformat = pytest.importorskip("nbformat", reason="pip install nbclient ipykernel")
    nbclient = pytest.importorskip("nbclient", reason="pip install nbclient ipykernel")
    pytest.importorskip("ipykernel", reason="pip install nbclient ipykernel")
    notebook = nbformat.read(stubs.EXAMPLES / "quickstart.ipynb", as_version=4)
    nbformat.validate(notebook)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert not any(cell.outputs or cell.execution_count for cell in code)
    monkeypatch.setenv("IPYTHONDIR", str(tmp_path))
    # The default kernel is this interpreter, whatever kernels are installed for the user.
    client = nbclient.NotebookClient(
        notebook, timeout=300, kernel_name="python3", resources={"metadata": {"path": tmp_path}}
    )
    client.execute()
    said = "".join(
        output.text for cell in code for output in cell.outputs if output.output_type == "stream"
    )
    pictures = sum(
        "image/png" in output.get("data", {}) for cell in code for output in cell.outputs
    )
    assert pictures == 3
    assert "coverage 100%" in said
    found = {name: float(value) for name, value in re.findall(r"(\w+): +RPE ([\d.]+)", said)}
    assert found["edvo"] < found["motion"] / 5
