#!/usr/bin/env python3
"""Unmodified programs of Aravis against `atomcam serve`, on addresses of this test's own."""

import os
import re
import subprocess
import unittest

ATOMCAM = os.environ["ATOMCAM"]
ADDRESSES = ["127.77.1.1", "127.77.1.2"]
VALUE = re.compile(r"^\s*(Integer|Float)\s*: \[RW\] '(\w+)' = ([-+.\deE]+)", re.MULTILINE)


def run(*arguments):
    done = subprocess.run(arguments, capture_output=True, text=True, timeout=60)
    return done.returncode, done.stdout + done.stderr


class AravisTools(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        addresses = [word for address in ADDRESSES for word in ("--address", address)]
        cls.server = subprocess.Popen([ATOMCAM, "serve", "ixon-ultra-897", "orca-quest", *addresses, "--quiet"],
                                      stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        for line in cls.server.stdout:
            if line.startswith("serving"):
                return
        raise RuntimeError("atomcam serve ended before it served")

    @classmethod
    def tearDownClass(cls):
        cls.server.terminate()
        cls.server.wait(20)
        cls.server.stdout.close()

    def test_writable_numbers_take_their_own_value(self):
        for address in ADDRESSES:
            _, text = run("arv-tool-0.8", "-a", address, "values")
            numbers = VALUE.findall(text)
            self.assertGreater(len(numbers), 10, text)
            code, answer = run("arv-tool-0.8", "-a", address, "control",
                               *[f"{name}={value}" for _, name, value in numbers])
            self.assertEqual(code, 0, answer)
            self.assertNotRegex(answer.lower(), "error|not found|invalid")

    def test_frames_of_the_preset_stream(self):
        code, text = run("arv-camera-test-0.8", "-n", ADDRESSES[0], "--duration=3")
        self.assertEqual(code, 0, text)
        counted = dict(re.findall(r"(n_\w+)\s*[=:]\s*(\d+)", text))
        self.assertGreater(int(counted["n_completed_buffers"]), 10, text)
        self.assertEqual(int(counted["n_failures"]), 0, text)


if __name__ == "__main__":
    unittest.main()
