"""The notebooks run from the first cell to the last, without an error and without a warning that a reader would see."""

import pathlib

import pytest

nbformat = pytest.importorskip("nbformat", reason="nbformat is not installed")
nbclient = pytest.importorskip("nbclient", reason="nbclient is not installed")

NOTEBOOKS = sorted((pathlib.Path(__file__).resolve().parents[1] / "notebooks").glob("*.ipynb"))


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
@pytest.mark.filterwarnings("default")
def test_a_notebook_runs(path, tmp_path):
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert code and not any(cell.outputs for cell in code), "outputs are not kept in the repository"
    nbclient.NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(tmp_path)}}).execute()
    printed = [output for cell in code for output in cell.outputs]
    assert not [output.text for output in printed if output.get("name") == "stderr"]
    pictures = sum("image/png" in output.get("data", {}) for output in printed)
    assert pictures == sum("plt.subplots" in cell.source for cell in code)


def test_there_are_notebooks():
    assert len(NOTEBOOKS) == 3
