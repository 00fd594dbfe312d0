"""Show the notebooks as pages of the site: a hook of MkDocs, which builds the pages.

The hook runs the cells and shows their outputs, which takes half a minute to a minute. With RUN_NOTEBOOKS=0
it shows code and text alone.
"""

from __future__ import annotations

import ast
import base64
import io
import json
import os
from contextlib import chdir, redirect_stdout
from pathlib import Path
from typing import Any

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

RUN = os.environ.get("RUN_NOTEBOOKS") != "0"


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add a page for each notebook."""
    for path in sorted(Path(config.docs_dir).glob("notebooks/*.ipynb")):
        page = f"notebooks/{path.stem}.md"
        files.append(File.generated(config, page, content=notebook_page(path)))
    return files


def on_page_markdown(markdown: str, **kwargs: Any) -> str:
    """Let links to notebooks lead to their pages."""
    return markdown.replace(".ipynb)", ".md)")


def notebook_page(path: Path) -> str:
    """Markdown of a notebook's cells, and of their outputs where they are run."""
    names: dict[str, Any] = {}
    parts = []
    with chdir(path.parent):
        for cell in json.loads(path.read_text())["cells"]:
            source = "".join(cell["source"])
            if cell["cell_type"] == "markdown":
                parts.append(source)
            else:
                parts.append(f"```python\n{source}\n```")
                parts += _outputs(source, names) if RUN else []
    return "\n\n".join(parts) + "\n"


def _outputs(source: str, names: dict[str, Any]) -> list[str]:
    """Run a cell: its prints, the value of its last line unless it ends in `;`, and its figures."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    body = ast.parse(source).body
    shown, printed, value = [], io.StringIO(), None
    with redirect_stdout(printed):
        last = body.pop() if isinstance(body[-1], ast.Expr) else None
        exec(compile(ast.Module(body, []), "notebook", "exec"), names)
        if last is not None:
            value = eval(compile(ast.Expression(last.value), "notebook", "eval"), names)
    if printed.getvalue():
        shown.append(f"```text\n{printed.getvalue()}```")
    if value is not None and not source.rstrip().endswith(";"):
        html = getattr(value, "_repr_html_", None)
        shown.append(f"<div>{html()}</div>" if html else f"```text\n{value!r}\n```")
    for number in pyplot.get_fignums():
        picture = io.BytesIO()
        pyplot.figure(number).savefig(picture, format="png", dpi=90, bbox_inches="tight")
        shown.append(f"![figure](data:image/png;base64,{base64.b64encode(picture.getvalue()).decode()})")
    pyplot.close("all")
    return shown
