"""Calibrating from Python: the same as the command, from arrays or files; what is put in comes out with errors."""

import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import unittest

import numpy as np

import atomcam
import practice
from atomcam import _core


class Calibrations(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.lab = practice.lab()
        cls.counts, _ = cls.lab.render(60)
        cls.darks = practice.darks_of(cls.lab, 40)
        cls.found = atomcam.calibrate(cls.counts, practice.NOTES, cls.darks)
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        cls.folder = folder.name

    def file(self, name):
        return os.path.join(self.folder, name)

    def within(self, row, truth):
        self.assertGreater(row["error"], 0)
        self.assertLess(abs(row["fit"] - truth), 5 * row["error"], f"{row} against {truth}")

    def test_what_was_put_in_comes_out(self):
        found, mode = self.found, self.lab._inner.readout_mode()
        self.within(found["camera.bias_counts"], self.lab["camera.bias_counts"])
        self.within(found["camera.em_gain / electrons_per_count"],
                    self.lab["camera.em_gain"] / mode["electrons_per_count"])
        self.within(found["atoms.filling"], self.lab["atoms.filling"])
        self.within(found["atoms.grid.offset_x_px"], practice.PLACES[0][0])
        self.within(found["atoms.grid.spacing_y_px"], 11)
        # The notes are where they were, and far off.
        bias = found["camera.bias_counts"]
        self.assertEqual(bias["notes"], 190)
        self.assertGreater(bias["pull"], 5)
        self.assertEqual(bias["pull"], (bias["fit"] - bias["notes"]) / bias["error"])
        self.assertTrue(found["sensor.electrons_per_count"]["from_notes"])
        self.assertIsNone(found["sensor.electrons_per_count"]["error"])
        self.assertEqual([set(row) for row in found.parameters],
                         [{"name", "notes", "fit", "error", "unit", "pull", "from_notes"}] * len(found.parameters))
        with self.assertRaisesRegex(atomcam.Error, "camera.bias_counts"):
            found["camera.bias"]

    def test_sites(self):
        found = self.found
        self.assertEqual(found.sites.shape, (16, 2))
        # The middle of all sites has the error that is told.
        off = found.sites.mean(0) - np.mean(practice.PLACES, 0)
        self.assertLess(abs(off).max(), 5 * found.site_error_px)
        lab = found.lab
        np.testing.assert_allclose(lab.sites[:, 0] - lab["camera.offset_x_px"], found.sites[:, 0], atol=1e-3)
        np.testing.assert_allclose(lab.sites[:, 1] - lab["camera.offset_y_px"], found.sites[:, 1], atol=1e-3)

    def test_the_lab_renders_and_is_a_copy(self):
        lab = self.found.lab
        self.assertEqual(lab["camera.bias_counts"], self.found["camera.bias_counts"]["fit"])
        counts, _ = lab.render(60)
        # Frames of the calibrated lab are as bright as those it comes from: 5 errors of the mean over frames.
        means, real = counts.mean((1, 2)), self.counts.mean((1, 2))
        self.assertLess(abs(means.mean() - real.mean()), 5 * np.hypot(means.std(), real.std()) / np.sqrt(60))
        lab["camera.em_gain"] = 1
        self.assertNotEqual(self.found.lab["camera.em_gain"], 1)

    def test_is_the_commands(self):
        np.save(self.file("frames.npy"), self.counts)
        np.save(self.file("darks.npy"), self.darks)
        with open(self.file("notes.json"), "w") as notes:
            json.dump(practice.NOTES, notes)
        subprocess.run([os.environ["ATOMCAM"], "calibrate", "--frames", "frames.npy", "--darks", "darks.npy", "--lab",
                        "notes.json", "-o", "lab.toml", "--report", "report"], cwd=self.folder, check=True,
                       capture_output=True)
        with open(self.file("report/calibration.json")) as written:
            self.assertEqual(self.found.as_dict(), json.load(written))
        self.assertEqual(self.found.lab, atomcam.Lab.load(self.file("lab.toml")))
        # From files, too.
        again = atomcam.calibrate(self.file("frames.npy"), self.file("notes.json"), self.file("darks.npy"))
        self.assertEqual(again.as_dict(), self.found.as_dict())

    def test_background_and_flats_are_the_commands(self):
        dark = practice.lab(**{"atoms.filling": 0})
        background, _ = dark.render(20, 20000)
        flats = {}
        for level in (1, 2, 4):
            dark["light.stray_light_photons_per_s"] = 20 * level
            flats[level] = dark.render(12, 30000 + 100 * level)[0]
        found = atomcam.calibrate(self.darks, practice.NO_SITES, self.darks, background, flats)
        files = ["calibrate", "--frames", "darks.npy", "--darks", "darks.npy", "--background", "background.npy"]
        np.save(self.file("darks.npy"), self.darks)
        np.save(self.file("background.npy"), background)
        for level, frames in flats.items():
            np.save(self.file(f"flat{level}.npy"), frames)
            files += ["--flats", f"flat{level}.npy", "--flats-exposure", str(level)]
        with open(self.file("no_sites.json"), "w") as notes:
            json.dump(practice.NO_SITES, notes)
        subprocess.run([os.environ["ATOMCAM"], *files, "--lab", "no_sites.json", "-o", "lit.toml", "--report", "lit"],
                       cwd=self.folder, check=True, capture_output=True)
        with open(self.file("lit/calibration.json")) as written:
            self.assertEqual(found.as_dict(), json.load(written))
        # Without exposures, nothing is said about the linearity; without flats, nothing about them.
        rows = [len(atomcam.calibrate(self.darks, practice.NO_SITES, self.darks, flats=some).parameters)
                for some in (flats, list(flats.values()), None)]
        self.assertEqual(rows, sorted(rows, reverse=True))
        self.assertEqual(len(set(rows)), 3)

    def test_arrays_of_any_layout_and_type(self):
        expected = atomcam.calibrate(self.counts[::2], practice.NO_SITES).as_dict()
        for other in (np.array(self.counts[::2]), np.asfortranarray(self.counts[::2]), self.counts[::2].astype(float),
                      self.counts[::2].astype(">u2"), self.counts[::2].astype(np.int32)):
            self.assertEqual(atomcam.calibrate(other, practice.NO_SITES).as_dict(), expected)

    def test_nothing_is_copied(self):
        # uint16 of any strides is held, not taken over.
        for array in (self.counts, self.counts[::-1, :, ::2]):
            before = sys.getrefcount(array)
            frames = _core.Frames.of_array(array)
            self.assertEqual(frames.shape(), array.shape)
            self.assertEqual(sys.getrefcount(array), before + 1)
            del frames
            self.assertEqual(sys.getrefcount(array), before)

    def test_report(self):
        self.found.write_report(self.file("plain"))
        self.assertEqual(sorted(os.listdir(self.file("plain"))), ["calibration.json", "report.html"])
        with open(self.file("plain/calibration.json")) as written:
            self.assertEqual(json.load(written), self.found.as_dict())
        with open(self.file("plain/report.html")) as page:
            self.assertIn("atomcam.calibrate(frames=&lt;uint16 array [60, 64, 64]&gt;", page.read())
        with self.assertRaises(atomcam.Error):
            self.found.write_report(self.file("plain/report.html"))

    def test_full_model(self):
        found = atomcam.calibrate(self.counts, practice.NOTES, self.darks, model="full")
        self.assertIsNone(self.found.site_brightness)
        brightness, error = found.site_brightness.T
        # All sites are alike: chi square of 16 below its 1 - 1e-6 quantile.
        self.assertLess((((brightness - 1) / error) ** 2).sum(), 61.6)
        self.assertEqual(self.found.maps, {})
        self.assertEqual({name: map.shape for name, map in found.maps.items()},
                         dict.fromkeys(["offset_counts", "offset_error_counts", "noise_counts", "noise_error_counts"], (64, 64)))
        found.write_report(self.file("full"))
        np.testing.assert_array_equal(np.load(self.file("full/offset_counts.npy"))[0],
                                      found.maps["offset_counts"].astype(np.float32))

    def test_refuses(self):
        notes, counts = practice.NOTES, self.counts
        fractions = counts[:10] + 0.5
        missing = counts[:10].astype(float)
        missing[3, 4, 5] = np.nan
        for words, arguments, options in [
                ("plain, full", (counts, notes), {"model": "fullest"}),
                ("frames: shape", (counts[0], notes), {}),
                ("darks: shape", (counts, notes, counts[0]), {}),
                ("frame 0 holds .*[.]5", (fractions, notes), {}),
                ("frame 3 holds nan", (missing, notes), {}),
                ("frame 0 holds -", (-counts[:10].astype(int), notes), {}),
                ("frame 0 holds 65[5-9]..", (counts[:10].astype(int) + 65536, notes), {}),
                ("frames: type", (counts > 0, notes), {}),
                ("64 x 65", (counts, {**notes, "shape": [64, 65]}), {}),
                ("notes: settings", (counts, {**notes, "settings": {"em_gain": "high"}}), {}),
                ("notes: of type list", (counts, []), {}),
                ("notes: value", (counts, {**notes, "settings": {"em_gain": {1}}}), {}),
                ("none.tif", ("none.tif", notes), {}),
                ("8 or more", (counts[:3], notes), {}),
                ("flats", (counts, notes), {"flats": "flats.tif"}),
                ("flats", (counts, notes), {"flats": {-1: counts}}),
                ("darks", (counts, notes), {"flats": [counts]}),
                ("background_exposure_s", (counts, notes), {"background_exposure_s": 0})]:
            with self.assertRaisesRegex(atomcam.Error, words):
                atomcam.calibrate(*arguments, **options)

    def test_keys_that_are_not_understood_are_told(self):
        notes = {**practice.NO_SITES, "settings": {**practice.SETTINGS, "shoe_size": np.float32(43)}}
        with self.assertWarnsRegex(UserWarning, "shoe_size"):
            atomcam.calibrate(self.darks, notes)

    def test_progress_on_the_calling_thread(self):
        told = []
        atomcam.calibrate(self.darks, practice.NO_SITES, progress=lambda step, done: told.append(
            (step, done, threading.get_ident())))
        self.assertEqual(told[-1][:2], ("done", 1))
        self.assertEqual({thread for _, _, thread in told}, {threading.get_ident()})
        self.assertEqual([done for _, done, _ in told], sorted(done for _, done, _ in told))

    def test_what_progress_raises_ends_the_work(self):
        def fail(step, done):
            raise ZeroDivisionError(step)

        before = threading.active_count()
        with self.assertRaises(ZeroDivisionError):
            atomcam.calibrate(self.counts, practice.NOTES, progress=fail)
        self.assertEqual(threading.active_count(), before)

    def test_an_interrupt_ends_it(self):
        held = signal.signal(signal.SIGINT, signal.default_int_handler)
        self.addCleanup(signal.signal, signal.SIGINT, held)
        steps = []

        def interrupt(step, done):
            steps.append(step)
            os.kill(os.getpid(), signal.SIGINT)

        with self.assertRaises(KeyboardInterrupt):
            atomcam.calibrate(self.counts, practice.NOTES, self.darks, progress=interrupt)
        self.assertEqual(len(steps), 1)


if __name__ == "__main__":
    unittest.main()
