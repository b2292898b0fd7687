"""Execute notebooks from top to bottom and keep what they show, without timings: ``make notebooks``."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import nbformat
from nbclient import NotebookClient
from traitlets.config import Config


def executed(path: Path, folder: Path) -> nbformat.NotebookNode:
    """A notebook with fresh outputs, run in a folder.

    Raises:
        CellExecutionError: a cell that fails.
    """
    notebook = nbformat.read(path, as_version=4)
    for cell in notebook.cells:
        if cell.cell_type == "code":
            cell.outputs, cell.execution_count = [], None
    with tempfile.TemporaryDirectory() as private:
        # The kernel listens at files of its own, not at ports that anybody on the machine can speak to.
        config = Config(KernelManager={"transport": "ipc", "ip": f"{private}/kernel"})
        where = {"metadata": {"path": str(folder)}}
        client = NotebookClient(notebook, resources=where, config=config, timeout=600)
        client.record_timing, client.coalesce_streams = False, True
        client.execute()
    notebook.metadata = {"kernelspec": notebook.metadata["kernelspec"], "language_info": {"name": "python"}}
    return notebook


def main() -> None:
    """Execute the notebooks named on the command line, each in its own folder, and write them back."""
    for name in sys.argv[1:]:
        path = Path(name)
        nbformat.write(executed(path, path.parent), path)


if __name__ == "__main__":
    main()
