"""Every notebook runs from top to bottom, and is committed as it ran: with outputs, without errors, small."""

import os
import re
from pathlib import Path

import nbformat
import pytest

ROOT = Path(__file__).resolve().parents[1]
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
BYTES, PICTURE_BYTES = 600_000, 60_000
MACHINE = re.compile(r"(/(home|root|tmp|usr|work|opt|Users)/\w|[A-Z]:\\\\)")

each = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)


def code_cells(path):
    return [cell for cell in nbformat.read(path, as_version=4).cells if cell.cell_type == "code"]


def test_all_six_are_there():
    assert [path.stem[:2] for path in NOTEBOOKS] == ["01", "02", "03", "04", "05", "06"]


@each
def test_it_is_committed_as_it_ran(path):
    nbformat.validate(nbformat.read(path, as_version=4))
    cells = code_cells(path)
    assert [cell.execution_count for cell in cells] == list(range(1, len(cells) + 1)), "run it from the top"
    outputs = [output for cell in cells for output in cell.outputs]
    assert not [output for output in outputs if output.output_type == "error"]
    assert not [output.text for output in outputs if output.get("name") == "stderr"], "no warnings"
    shown = [output.data for output in outputs if "data" in output]
    pictures = [content for data in shown for kind, content in data.items() if kind.startswith("image/")]
    assert pictures and max(map(len, pictures)) * 3 / 4 <= PICTURE_BYTES and path.stat().st_size <= BYTES
    words = "".join(cell.source + str([o.get("text", "") for o in cell.outputs]) for cell in cells)
    words += str([data.get("text/plain", "") for data in shown])
    assert not MACHINE.search(words), MACHINE.search(words)
    assert any(re.search(r"^assert ", cell.source, flags=re.M) for cell in cells), (
        "at least one number is asserted"
    )


@pytest.mark.slow
@each
def test_it_runs(path, offscreen, monkeypatch):
    nbclient = pytest.importorskip("nbclient")
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")]))
    notebook = nbformat.read(path, as_version=4)
    nbclient.NotebookClient(
        notebook, timeout=180, resources={"metadata": {"path": str(path.parent)}}
    ).execute()
    assert all(cell.execution_count for cell in notebook.cells if cell.cell_type == "code")
