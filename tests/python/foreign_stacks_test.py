"""Stacks of a simulator that shares nothing with ours, diagnosed blindly: no gap without an effect; a bias that differs
between quadrants, which no effect of the catalogue is, stays unexplained."""

import os
import subprocess
import sys
import tempfile
import unittest

GENERATOR = os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "diagnosis", "foreign_stacks.py")


class ForeignStacks(unittest.TestCase):
    def test_they_are_scored(self):
        with tempfile.TemporaryDirectory() as folder:
            subprocess.run([sys.executable, GENERATOR, "-n", "2", "-o", folder, "--effect", "none", "--effect", "quadrant_bias",
                            "--strength", "3", "--camera", "emccd", "--size", "48", "--frames", "40", "--darks", "16",
                            "--seed", "5"], check=True)
            result = subprocess.run([os.environ["ATOMCAM"], "blind", "score", folder, "--withhold", "--no-cache"],
                                    capture_output=True, text=True)
        self.assertEqual(result.returncode, 0, result.stderr)
        self.assertIn("| (none) | no_gap (1) |", result.stdout)
        self.assertIn("| quadrant_bias | unexplained (1) |", result.stdout)
        self.assertNotIn("within one error", result.stdout)  # its strengths are not told in our units


if __name__ == "__main__":
    unittest.main()
