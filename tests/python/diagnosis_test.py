"""Diagnosing from Python: the same as the command, from arrays or files; other threads run, Ctrl-C ends it."""

import hashlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
import unittest

import numpy as np

import atomcam
import practice


class Diagnoses(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        # Without atoms: where the notes list none, it is quick.
        lab = practice.lab(**{"atoms.filling": 0})
        cls.plain, _ = lab.render(48)
        lab["effects.row_noise"] = 0.8
        cls.noisy, _ = lab.render(48)
        cls.darks = practice.darks_of(lab, 40)
        cls.folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(cls.folder.cleanup)

    @classmethod
    def file(cls, name):
        return os.path.join(cls.folder.name, name)

    def where(self, frames, notes=practice.NO_SITES, **options):
        return atomcam.diagnose(frames, notes, where_only=True, **options)

    def test_no_gap(self):
        found = self.where(self.plain)
        self.assertEqual((found.verdict, found.effects), ("no_gap", []), found.sentence)
        self.assertFalse(found.unexplained["present"])
        self.assertEqual(found.lab, found.plain_lab)
        self.assertIn(found.sentence, repr(found))

    def test_found_and_written(self):
        out, told = self.file("found"), []
        found = atomcam.diagnose(
            self.noisy, practice.NO_SITES, include=["row_noise"], seed=5, out=out,
            progress=lambda step, done: told.append((step, done, threading.get_ident())))
        self.assertEqual(found.verdict, "explained", found.sentence)
        (effect,) = found.effects
        self.assertEqual((effect["name"], effect["stage"]), ("row_noise", "sensor"))
        strength = effect["parameters"]["sigma_counts"]
        self.assertLess(abs(strength["value"] - 0.8), 5 * strength["error"])
        self.assertLess(found.gap["after"], found.gap["before"])
        # The lab has the effect, and renders; the plain one does not.
        lab = found.lab
        self.assertEqual(lab["effects.row_noise"], strength["value"])
        self.assertEqual(lab.render(2)[0].shape, (2, 64, 64))
        self.assertEqual(found.plain_lab["effects.row_noise"], 0)
        # What was written is what is here.
        self.assertEqual(sorted(os.listdir(out)), ["diagnosis.json", "lab.toml", "report.html"])
        with open(os.path.join(out, "diagnosis.json")) as written:
            self.assertEqual(json.load(written), found.as_dict())
        self.assertEqual(atomcam.Lab.load(os.path.join(out, "lab.toml")), atomcam.Lab.parse(lab.text()))
        with open(os.path.join(out, "report.html")) as page:
            self.assertIn(found.sentence, page.read())
        # Later, too.
        found.write(self.file("later"))
        for name in os.listdir(out):
            with open(os.path.join(out, name)) as one, open(os.path.join(self.file("later"), name)) as other:
                self.assertEqual(one.read(), other.read(), name)
        inputs = found.as_dict()["inputs"]
        self.assertEqual(inputs["frames"]["sha256"], hashlib.sha256(self.noisy.tobytes()).hexdigest())
        self.assertEqual((inputs["frames"]["frames"], inputs["frames"]["shape"]), (48, [64, 64]))
        self.assertEqual(inputs["frames"]["looked_at"], 48)
        self.assertEqual((inputs["include"], inputs["seed"]), (["row_noise"], 5))
        self.assertIn("atomcam.diagnose(frames=<uint16 array [48, 64, 64]>", inputs["command"])
        # Told on the calling thread, forwards, to the end.
        self.assertEqual({thread for _, _, thread in told}, {threading.get_ident()})
        self.assertEqual([done for _, done, _ in told], sorted(done for _, done, _ in told))
        self.assertEqual(told[-1][:2], ("done", 1))
        self.assertIn("report", {step for step, _, _ in told})

    def test_is_the_commands(self):
        np.save(self.file("frames.npy"), self.noisy)
        np.save(self.file("darks.npy"), self.darks)
        with open(self.file("notes.json"), "w") as notes:
            json.dump(practice.NO_SITES, notes)
        command = subprocess.run(
            [os.environ["ATOMCAM"], "diagnose", "--frames", "frames.npy", "--darks", "darks.npy", "--lab", "notes.json",
             "--out", "out", "--no-cache", "--where-only", "--threads", "1", "--seed", "3"], cwd=self.folder.name, capture_output=True)
        self.assertEqual(command.returncode, 2, command.stderr)
        with open(self.file("out/diagnosis.json")) as written:
            theirs = json.load(written)
        here = os.getcwd()
        self.addCleanup(os.chdir, here)
        os.chdir(self.folder.name)
        files = self.where("frames.npy", "notes.json", darks="darks.npy", threads=2, seed=3, all_frames=True).as_dict()
        self.assertIn("all_frames=True", files["inputs"]["command"])
        arrays = self.where(self.noisy, darks=self.darks, threads=2, seed=3, cache="kept").as_dict()
        self.assertTrue(os.listdir("kept"))
        again = self.where(self.noisy, darks=self.darks, threads=2, seed=3, cache="kept").as_dict()
        self.assertLess(again["seconds"], arrays["seconds"])
        for one in (theirs, files, arrays, again):
            del one["seconds"], one["inputs"]["command"]
        self.assertEqual(files, theirs)
        self.assertEqual(again, arrays)
        for role in ("frames", "darks"):
            self.assertEqual(arrays["inputs"][role]["shape"], files["inputs"][role]["shape"])
        for one in (files, arrays):
            del one["inputs"]
        self.assertEqual(arrays, files)

    def test_background_and_flats_are_the_commands(self):
        lab = practice.lab(**{"atoms.filling": 0})
        stacks = {"frames": self.plain, "darks": self.darks, "background": lab.render(20, 20000)[0]}
        flats = {}
        for level in (1, 2, 4):
            lab["light.stray_light_photons_per_s"] = 20 * level
            flats[level] = lab.render(12, 30000 + 100 * level)[0]
        files = []
        for name, frames in [*stacks.items(), *((f"flat{level}", one) for level, one in flats.items())]:
            np.save(self.file(name + ".npy"), frames)
            files += [f"--{name}" if name in stacks else "--flats", name + ".npy"]
        with open(self.file("dark_notes.json"), "w") as notes:
            json.dump(practice.NO_SITES, notes)
        subprocess.run(
            [os.environ["ATOMCAM"], "diagnose", *files, "--flats-exposure", "1", "2", "4", "--lab", "dark_notes.json",
             "--out", "lit", "--no-cache", "--where-only"], cwd=self.folder.name, capture_output=True)
        with open(self.file("lit/diagnosis.json")) as written:
            theirs = json.load(written)
        mine = self.where(flats=flats, **stacks).as_dict()
        self.assertEqual(set(mine["inputs"]), set(theirs["inputs"]))
        self.assertIn("flats_3", mine["inputs"])
        for one in (mine, theirs):
            del one["seconds"], one["inputs"]
        self.assertEqual(mine, theirs)

    def test_one_stack_against_another(self):
        same = atomcam.diagnose(self.plain[:24], practice.NO_SITES, against=self.plain[24:])
        self.assertEqual(same.verdict, "no_gap", same.sentence)
        found = atomcam.diagnose(self.noisy, practice.NO_SITES, against=self.plain, out=self.file("against"))
        self.assertEqual(found.verdict, "unexplained", found.sentence)
        self.assertIn(".lines.rows.", found.where[0]["statistic"])
        with open(self.file("against/diagnosis.json")) as written:
            self.assertEqual(json.load(written), found.as_dict())
        self.assertEqual(found.as_dict()["inputs"]["against"]["sha256"],
                         hashlib.sha256(self.plain.tobytes()).hexdigest())

    def test_other_threads_run_meanwhile(self):
        done, ticks = threading.Event(), 0

        def work():
            self.where(self.plain, threads=1)
            done.set()

        thread = threading.Thread(target=work)
        thread.start()
        while not done.is_set():
            time.sleep(0.001)
            ticks += 1
        thread.join()
        self.assertGreater(ticks, 100)  # with the interpreter locked: one or two

    def test_what_progress_raises_ends_the_work(self):
        def fail(step, done):
            raise ZeroDivisionError(step)

        before = threading.active_count()
        with self.assertRaises(ZeroDivisionError):
            self.where(self.plain, progress=fail, out=self.file("failed"))
        self.assertEqual(threading.active_count(), before)
        self.assertFalse(os.path.exists(self.file("failed")))

    def test_an_interrupt_ends_it_soon(self):
        script = """
import signal, sys, time, numpy, atomcam, practice
signal.signal(signal.SIGINT, signal.default_int_handler)  # who runs in the background ignores it
frames = numpy.load("noisy.npy")
def progress(step, done):
    if done > 0.3:  # the effects are looked for
        print("ready", flush=True)
try:
    atomcam.diagnose(frames, practice.NO_SITES, progress=progress, out="interrupted")
except KeyboardInterrupt:
    sys.exit(42)
"""
        np.save(self.file("noisy.npy"), self.noisy)
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(
            [os.path.dirname(os.path.abspath(__file__)), os.environ.get("PYTHONPATH", "")])}
        process = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True,
                                   cwd=self.folder.name, env=environment)
        self.addCleanup(process.stdout.close)
        self.assertEqual(process.stdout.readline().strip(), "ready")
        process.send_signal(signal.SIGINT)
        self.assertEqual(process.wait(timeout=10), 42)  # without: minutes
        self.assertFalse(os.path.exists(self.file("interrupted")))

    def test_refuses(self):
        notes = practice.NO_SITES
        with open(self.file("file"), "w"):
            pass
        for words, arguments, options in [
                ("row_nois.*catalogue", (self.plain, notes), {"exclude": ["row_nois"]}),
                ("exclude", (self.plain, notes), {"exclude": "row_noise"}),
                ("frames: shape", (self.plain[0], notes), {}),
                ("9 frames.*10", (self.plain[:9], notes), {}),
                ("64 x 65", (self.plain, {**notes, "shape": [64, 65]}), {}),
                ("darks", (self.plain, notes), {"darks": self.darks[:, :32]}),
                ("against", (self.plain, notes), {"against": self.plain, "exclude": ["row_noise"]}),
                ("seed", (self.plain, notes), {"seed": -1}),
                ("threads", (self.plain, notes), {"threads": 0}),
                ("none.tif", ("none.tif", notes), {}),
                ("out", (self.plain, notes), {"out": self.file("file")}),
                ("out", (self.plain, notes), {"out": ""})]:
            with self.assertRaisesRegex(atomcam.Error, words):
                atomcam.diagnose(*arguments, where_only=True, **options)


if __name__ == "__main__":
    unittest.main()
