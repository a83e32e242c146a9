"""`pip install .` in an empty virtual environment gives a module that renders the same bits. Skipped, saying why, where
PyPI cannot be reached: pip fetches the build's tools and NumPy from there."""

import os
import shutil
import subprocess
import sys
import tempfile
import unittest

import numpy as np

import atomcam

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
LABS = os.path.join(ROOT, "labs")
SCRIPT = """
import sys, numpy, atomcam
counts, truth = atomcam.Lab.load(sys.argv[1]).render(2)
numpy.savez("rendered.npz", counts=counts, **truth.arrays())
print(atomcam.__version__, atomcam.__file__)
"""


class Wheel(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.mkdtemp()
        self.addCleanup(shutil.rmtree, self.folder)
        self.python = os.path.join(self.folder, "venv", "bin", "python")
        # Not what this test runs with: neither the module that is built here nor Debian's packages.
        self.environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}

    def run_here(self, *command):
        return subprocess.run(command, cwd=self.folder, env=self.environment, capture_output=True, text=True)

    def test_pip_install(self):
        made = self.run_here(sys.executable, "-m", "venv", "venv")
        if made.returncode != 0:
            self.skipTest(f"no virtual environment here: {made.stdout.strip()}")
        pip = [self.python, "-m", "pip", "--disable-pip-version-check", "--retries", "1", "--timeout", "15"]
        reached = self.run_here(*pip, "install", "numpy")
        if reached.returncode != 0:
            self.skipTest(f"PyPI cannot be reached: {reached.stderr.strip().splitlines()[-1:]}")
        installed = self.run_here(*pip, "install", "--no-deps", "--config-settings", f"build-dir={self.folder}/build", ROOT)
        self.assertEqual(installed.returncode, 0, installed.stdout[-3000:] + installed.stderr[-3000:])
        lab = os.path.join(LABS, "ixon.toml")
        ran = self.run_here(self.python, "-c", SCRIPT, lab)
        self.assertEqual(ran.returncode, 0, ran.stderr)
        version, place = ran.stdout.split()
        self.assertEqual(version, atomcam.__version__)
        self.assertTrue(place.startswith(self.folder), place)
        shown = self.run_here(*pip, "show", "--files", "atomcam").stdout
        for file in ("atomcam/py.typed", "atomcam/_core.pyi", "atomcam/dask.py"):
            self.assertIn(file, shown)
        counts, truth = atomcam.Lab.load(lab).render(2)
        rendered = np.load(os.path.join(self.folder, "rendered.npz"))
        np.testing.assert_array_equal(rendered["counts"], counts)
        for name, array in truth.arrays().items():
            np.testing.assert_array_equal(rendered[name], array)


if __name__ == "__main__":
    unittest.main()
