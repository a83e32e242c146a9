"""The atomcam command from outside: what it writes, how it ends, what it says about bad input."""

import json
import os
import resource
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import time
import unittest

ATOMCAM = os.environ["ATOMCAM"]
SMALL = ["--set", "camera.width_px=64", "--set", "camera.height_px=64",
         "--set", "camera.offset_x_px=192", "--set", "camera.offset_y_px=192"]


def run(*arguments, **options):
    return subprocess.run([ATOMCAM, *arguments], capture_output=True, text=True, timeout=120, **options)


def npy(file):
    """Shape and raw bytes of an array."""
    with open(file, "rb") as stream:
        content = stream.read()
    length = struct.unpack("<H", content[8:10])[0]
    return eval(content[10:10 + length])["shape"], content[10 + length:]


class Commands(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)

    def file(self, name, content=None):
        path = os.path.join(self.folder.name, name)
        if content is not None:
            with open(path, "w") as stream:
                stream.write(content)
        return path

    def good(self, *arguments):
        result = run(*arguments)
        self.assertEqual(result.returncode, 0, result.stderr)
        return result

    def refused(self, words, *arguments, code=2, **options):
        """One clear line and the exit code."""
        result = run(*arguments, **options)
        self.assertEqual(result.returncode, code, result.stderr)
        lines = result.stderr.splitlines()
        self.assertEqual(len(lines), 1, result.stderr)
        self.assertTrue(lines[0].startswith("atomcam"), lines[0])
        for word in words:
            self.assertIn(word, lines[0])

    # Rendering

    def test_threads_and_first_do_not_change_a_frame(self):
        self.good("render", "ixon-ultra-897", "-n", "6", "-o", self.file("a.npy"), "--threads", "1", *SMALL)
        self.good("render", "ixon-ultra-897", "-n", "6", "-o", self.file("b.npy"), "--threads", "5", *SMALL)
        self.good("render", "ixon-ultra-897", "-n", "2", "--first", "4", "-o", self.file("c.npy"), *SMALL)
        self.good("render", "ixon-ultra-897", "-n", "6", "-o", self.file("d.npy"), "--seed", "2", *SMALL)
        a, b, c, d = (npy(self.file(f"{name}.npy")) for name in "abcd")
        self.assertEqual(a, b)
        self.assertEqual(a[1][len(a[1]) // 6 * 4:], c[1])
        self.assertNotEqual(a[1], d[1])
        with open(self.file("a.truth.jsonl")) as one, open(self.file("c.truth.jsonl")) as other:
            self.assertEqual(one.readlines()[4:], other.readlines())

    def test_truth_and_settings_stand_beside_the_pixels(self):
        self.good("render", "orca-quest", "-n", "2", "-o", self.file("a.npy"), "--set", "camera.width_px=64",
                  "--set", "camera.height_px=48")
        self.assertEqual(npy(self.file("a.npy"))[0], (2, 48, 64))
        with open(self.file("a.truth.jsonl")) as stream:
            truths = [json.loads(line) for line in stream]
        self.assertEqual([truth["frame"] for truth in truths], [0, 1])
        with open(self.file("a.settings.json")) as stream:
            notes = json.load(stream)
        self.assertEqual(notes["settings"]["electrons_per_count"], 0.107)
        self.good("lab", "--check", self.file("lab.toml", notes["lab"]))

    def test_expected_electrons(self):
        self.good("render", "ixon-ultra-897", "-n", "3", "-o", self.file("a.tif"), "--expected", self.file("e.npy"))
        shape, content = npy(self.file("e.npy"))
        self.assertEqual(shape, (3, 256, 256))
        values = struct.unpack(f"<{3 * 256 * 256}f", content)
        self.assertGreater(min(values), 0)
        self.assertGreater(max(values), 5 * min(values))

    def test_interrupt_keeps_what_is_done(self):
        for extension in ("npy", "h5", "tif", "fits"):
            with self.subTest(extension):
                file = self.file("long." + extension)
                process = subprocess.Popen([ATOMCAM, "render", "ixon-ultra-897", "-n", "1000000", "-o", file, *SMALL],
                                           stderr=subprocess.PIPE, text=True)
                time.sleep(0.7)
                process.send_signal(signal.SIGINT)
                _, said = process.communicate(timeout=20)
                self.assertEqual(process.returncode, 0, said)
                self.assertIn("what is there is complete", said)
                # Its position and brightness are those of the truth, whatever number of frames it was.
                checked = run("check-truth", file, "--position", "3", "--sigmas", "20")
                self.assertEqual(checked.returncode, 0, checked.stderr + checked.stdout)
                frames = int(said.split(" frames")[0].split()[-1])
                self.assertIn(f" {frames} frames of", checked.stdout)

    # The check of truth is itself checked: it must see what is wrong.

    def test_check_truth_sees_shifts_brightness_and_mix_ups(self):
        file = self.file("a.npy")
        self.good("render", "ixon-ultra-897", "-n", "80", "-o", file, "--set",
                  "atoms.scattering_rate_hz=300000")
        self.good("check-truth", file, "--picture", self.file("a.png"))
        self.assertGreater(os.path.getsize(self.file("a.png")), 10000)
        with open(self.file("a.truth.jsonl")) as stream:
            truths = [json.loads(line) for line in stream]

        def spoilt(change):
            copy = json.loads(json.dumps(truths))
            for truth in copy:
                change(truth)
            self.file("a.truth.jsonl", "".join(json.dumps(truth) + "\n" for truth in copy))
            result = run("check-truth", file)
            self.assertEqual(result.returncode, 1, result.stdout)
            return result.stdout

        def shift(truth):
            for atom in truth["atoms"]:
                if atom["site"] == 100:
                    atom["x_px"] += 0.2

        def brighten(truth):
            for atom in truth["atoms"]:
                if atom["site"] == 100:
                    atom["detected_e"] *= 1.1

        def empty(truth):
            truth["atoms"] = [atom for atom in truth["atoms"] if atom["site"] != 100 or truth["frame"] % 4]

        self.assertIn("position    FAIL", spoilt(shift))
        self.assertIn("brightness  FAIL", spoilt(brighten))
        self.assertIn("empty sites FAIL", spoilt(empty))

    # Bad input

    def test_score_holds_a_result_against_the_truth(self):
        frames = self.file("frames.npy")
        self.good("render", "ixon-ultra-897", "-n", "6", "-o", frames)
        with open(self.file("frames.truth.jsonl")) as stream:
            truth = [json.loads(line)["initial"] for line in stream]
        result = self.file("perfect.json", json.dumps(truth))
        judged = json.loads(self.good("score", frames, "--result", result, "--json").stdout)
        self.assertEqual(judged["fidelity"]["part"], sum(map(len, truth)))
        self.assertEqual(judged["auc"]["value"], 1)
        wrong = [truth[0][::-1].translate({48: 49, 49: 48})[::-1]] + truth[1:]  # one frame turned about
        result = self.file("wrong.csv", "".join(",".join(frame) + "\n" for frame in wrong))
        curve = self.file("roc.csv")
        judged = json.loads(self.good("score", frames, "--result", result, "--json", "--roc", curve).stdout)
        self.assertEqual(judged["fidelity"]["part"], sum(map(len, truth[1:])))
        with open(curve) as stream:
            self.assertEqual(stream.readline().strip(), "threshold,false_alarms,found")
        text = self.good("score", frames, "--detector", "threshold").stdout
        self.assertIn("ROC area", text)
        self.refused(["--result", "--detector"], "score", frames)
        self.refused(["frame 5", "1 values"], "score", frames, "--result", self.file("short.csv", "".join(
            ",".join(frame) + "\n" for frame in truth[:5]) + "1\n"))

    def test_help_and_version(self):
        self.assertRegex(self.good("--version").stdout, r"^atomcam \d+\.\d+\.\d+\n$")
        for command in ("serve", "render", "grab", "check-truth"):
            self.assertIn("Examples:", self.good(command, "--help").stdout)

    def test_bad_arguments(self):
        self.refused(["rendr", "render"], "rendr")
        self.refused(["--output"], "render", "ixon-ultra-897")
        self.refused(["--frames"], "render", "ixon-ultra-897", "-n", "0", "-o", self.file("a.npy"))
        self.refused(["orca-qest", "orca-quest"], "render", "orca-qest", "-o", self.file("a.npy"))
        self.refused(["a.xyz", ".npy"], "render", "ixon-ultra-897", "-o", self.file("a.xyz"))
        self.refused(["atoms.filing", "atoms.filling"], "render", "ixon-ultra-897", "-o", self.file("a.npy"),
                     "--set", "atoms.filing=1")
        self.refused(["127.0.0.300"], "serve", "--address", "127.0.0.300")

    def test_bad_files(self):
        self.refused(["no_lab.toml"], "serve", self.file("no_lab.toml"))
        self.refused(["bad.toml"], "serve", self.file("bad.toml", "[atoms\nfilling = 1"))
        self.refused(["key.toml", "filing", "filling"], "serve", self.file("key.toml", "[atoms]\nfiling = 0.5\n"))
        self.refused(["no.xml", "no such file"], "serve", "--xml", self.file("no.xml"))
        self.refused(["a.npy", "No such file or directory"], "render", "ixon-ultra-897", "-o",
                     self.file("no_folder/a.npy"))
        self.refused(["a.h5", "no such file"], "check-truth", self.file("a.h5"))
        self.refused(["text.npy"], "check-truth", self.file("text.npy", "no array"))

    def test_full_disk(self):
        file = self.file("a.npy")
        os.symlink("/dev/full", file)
        self.refused(["a.npy", "No space left on device"], "render", "ixon-ultra-897", "-n", "5", "-o", file)

    def test_disk_full_on_the_way(self):
        def small_files():
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            resource.setrlimit(resource.RLIMIT_FSIZE, (1 << 20, 1 << 20))

        for extension in ("npy", "h5", "tif", "fits"):
            with self.subTest(extension):
                self.refused(["a." + extension, "File too large"], "render", "ixon-ultra-897", "-n", "50", "-o",
                             self.file("a." + extension), code=1, preexec_fn=small_files)

    # Serving

    def test_taken_port_and_foreign_address(self):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
            taken.bind(("127.0.61.1", 3956))
            self.refused(["127.0.61.1", "3956"], "serve", "ixon-ultra-897", "--address", "127.0.61.1")
        self.refused(["192.0.2.77"], "serve", "ixon-ultra-897", "--address", "192.0.2.77")

    def test_serve_ends_cleanly(self):
        for ending in (signal.SIGINT, signal.SIGTERM):
            process = subprocess.Popen([ATOMCAM, "serve", "ixon-ultra-897", "--address", "127.0.61.2"],
                                       stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
            for line in process.stdout:
                if line.startswith("serving"):
                    break
            process.send_signal(ending)
            _, errors = process.communicate(timeout=10)
            self.assertEqual(process.returncode, 0)
            self.assertEqual(errors, "")
        self.good("serve", "ixon-ultra-897", "--address", "127.0.61.2", "--duration", "0.2")

    def test_grab_gives_what_render_gives(self):
        process = subprocess.Popen([ATOMCAM, "serve", "ixon-ultra-897", "--address", "127.0.61.3"],
                                   stdout=subprocess.PIPE, text=True)
        try:
            for line in process.stdout:
                if line.startswith("serving"):
                    break
            self.good("grab", "127.0.61.3", "-n", "5", "-o", self.file("g.npy"), "--exposure-us", "20000",
                      "--set", "ReadoutRate=Rate17MHz", "--lab", "ixon-ultra-897")
            self.refused(["ExposurTime"], "grab", "127.0.61.3", "-o", self.file("x.npy"), "--set", "ExposurTime=1")
        finally:
            process.terminate()
            process.communicate(timeout=10)
        self.good("render", "ixon-ultra-897", "-n", "5", "-o", self.file("r.npy"), "--set", "camera.exposure_s=0.02",
                  "--set", "camera.readout_rate_hz=17e6")
        with open(self.file("g.truth.jsonl")) as one, open(self.file("r.truth.jsonl")) as other:
            self.assertEqual([json.loads(line) for line in one], [json.loads(line) for line in other])
        self.assertEqual(npy(self.file("g.npy")), npy(self.file("r.npy")))

    def test_grab_without_a_camera(self):
        self.refused(["127.0.61.9"], "grab", "127.0.61.9", "-o", self.file("a.npy"))


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1] + sys.argv[1:])
