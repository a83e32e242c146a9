"""Runs what the documents show: the code cells of the notebooks, and every block of docs/python.md that <!-- run -->
announces. Jupyter is not needed; cells that need Matplotlib run where it is installed."""

import contextlib
import importlib.util
import io
import json
import os
import re
import unittest

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
NOTEBOOKS = os.path.join(ROOT, "docs", "notebooks")


def run(blocks):
    """One after the other, as in one program; what they printed."""
    if importlib.util.find_spec("matplotlib"):
        import matplotlib

        matplotlib.use("Agg")
    names, printed = {"__name__": "__main__"}, io.StringIO()
    with contextlib.redirect_stdout(printed):
        for place, code in blocks:
            exec(compile(code, place, "exec"), names)
    return printed.getvalue()


def cells(file):
    with open(os.path.join(NOTEBOOKS, file)) as stream:
        notebook = json.load(stream)
    for number, cell in enumerate(notebook["cells"]):
        needs = {tag.removeprefix("needs-") for tag in cell["metadata"].get("tags", [])}
        if cell["cell_type"] == "code" and all(importlib.util.find_spec(module) for module in needs):
            yield f"{file}, cell {number}", "".join(cell["source"])


class Documents(unittest.TestCase):
    def test_notebooks(self):
        files = [file for file in os.listdir(NOTEBOOKS) if file.endswith(".ipynb")]
        self.assertIn("first_steps.ipynb", files)
        for file in files:
            self.assertIn("best threshold", run(cells(file)))

    def test_notebooks_are_kept_without_output(self):
        for file in os.listdir(NOTEBOOKS):
            with open(os.path.join(NOTEBOOKS, file)) as stream:
                for cell in json.load(stream)["cells"]:
                    self.assertFalse(cell.get("outputs") or cell.get("execution_count"), file)

    def test_python_md(self):
        with open(os.path.join(ROOT, "docs", "python.md")) as stream:
            blocks = re.findall(r"<!-- run -->\n```python\n(.*?)```", stream.read(), re.S)
        self.assertGreater(len(blocks), 4)
        printed = run((f"docs/python.md, block {n}", code) for n, code in enumerate(blocks))
        self.assertIn("the nearest is 'camera.em_gain'", printed)
        # Comments that tell what a line prints.
        self.assertIn("(100, 256, 256) uint16", printed)
        self.assertIn("(100, 306)", printed)
        self.assertIn("explained - row_noise", printed)


if __name__ == "__main__":
    unittest.main()
