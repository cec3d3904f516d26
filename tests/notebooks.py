"""Notebooks in percent format: cells begin with `# %%`, those of text with `# %% [markdown]`."""

import re
from pathlib import Path

import nbformat

_CELL = re.compile(r"^# %%(?P<text> \[markdown\])?\n(?P<body>.*?)(?=^# %%|\Z)", re.DOTALL | re.MULTILINE)


def read_notebook(path: Path) -> nbformat.NotebookNode:
    """Return the notebook that stands in a Python file."""
    cells = []
    for number, cell in enumerate(_CELL.finditer(path.read_text(encoding="utf-8"))):
        body = cell["body"].strip("\n")
        if cell["text"]:
            made = nbformat.v4.new_markdown_cell(re.sub(r"^# ?", "", body, flags=re.MULTILINE))
        else:
            made = nbformat.v4.new_code_cell(body)
        # The same bytes in every run.
        cells.append({**made, "id": f"cell-{number}"})
    metadata = {"kernelspec": {"name": "python3", "display_name": "Python 3", "language": "python"}}
    return nbformat.from_dict(nbformat.v4.new_notebook(cells=cells, metadata=metadata))
