"""Notebooks without Jupyter: run the cells, compare what they print with what is stored, and show them as a page.

python docs/_notebook.py docs/guide/tutorial.ipynb      # runs it and stores what its cells print
"""

import ast
import io
import json
import os
import sys
from collections.abc import Iterator
from contextlib import chdir, redirect_stdout
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any


def text_of(lines: list[str] | str) -> str:
    """The text of a cell or output, which a notebook stores as text or as its lines."""
    return "".join(lines)


def stored(cell: dict) -> str:
    """What a code cell printed when it was stored."""
    return "".join(text_of(output["text"]) for output in cell["outputs"] if output["output_type"] == "stream")


def run(path: Path) -> Iterator[tuple[dict, str, Any]]:
    """Run a notebook in an empty folder: each cell, what it prints, and the value of its last line."""
    space: dict[str, Any] = {"__name__": "__main__"}
    cells = json.loads(path.read_text())["cells"]
    with TemporaryDirectory() as folder:
        for number, cell in enumerate(cells):
            if cell["cell_type"] != "code":
                yield cell, "", None
                continue
            with chdir(folder), redirect_stdout(io.StringIO()) as printed:
                value = run_cell(text_of(cell["source"]), space, f"{path.name}, cell {number}")
            yield cell, printed.getvalue(), value


def run_cell(source: str, space: dict[str, Any], name: str) -> Any:
    """Run a cell in a namespace; magic lines are left out. Returns the value of a last line that is an expression."""
    code = "\n".join("" if line.startswith("%") else line for line in source.splitlines())
    body = ast.parse(code, name).body
    last = ast.Expression(body.pop().value) if body and isinstance(body[-1], ast.Expr) else None
    exec(compile(ast.Module(body, []), name, "exec"), space)
    return eval(compile(last, name, "eval"), space) if last else None


def page(path: Path) -> Iterator[tuple[str, str | bytes]]:
    """Run a notebook and generate (name, content) of its figures and, last, of its page."""
    text = ""
    for cell, printed, value in run(path):
        source = text_of(cell["source"])
        if cell["cell_type"] == "markdown":
            text += f"{source}\n\n"
            continue
        text += f"```python\n{source}\n```\n\n"
        if printed:
            text += f"```text\n{printed.rstrip()}\n```\n\n"
        if hasattr(value, "savefig"):
            name, buffer = f"{path.stem}_{text.count('![figure]') + 1}.svg", io.BytesIO()
            value.savefig(buffer, format="svg")
            text += f"![figure]({name})\n\n"
            yield name, buffer.getvalue()
        elif hasattr(value, "_repr_html_"):
            text += f"{value._repr_html_()}\n\n"
    yield f"{path.stem}.md", text


def store(path: Path) -> None:
    """Run a notebook and store what its cells print."""
    notebook = json.loads(path.read_text())
    for cell, (_, printed, _) in zip(notebook["cells"], run(path), strict=True):
        if cell["cell_type"] == "code":
            stream = {"name": "stdout", "output_type": "stream", "text": printed.splitlines(keepends=True)}
            cell["outputs"] = [stream] if printed else []
    path.write_text(json.dumps(notebook, indent=1, ensure_ascii=False) + os.linesep)


if __name__ == "__main__":
    store(Path(sys.argv[1]))
