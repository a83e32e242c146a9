"""Frames and their truth: the same bits everywhere, straight into the array's memory, others run meanwhile."""

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
import small


class Frames(unittest.TestCase):
    def test_are_those_of_the_command_with_its_truth(self):
        for preset in atomcam.presets():
            lab = small.lab(preset, **{"effects.pointing_drift": 0.2})
            with tempfile.TemporaryDirectory() as folder:
                lab.save(os.path.join(folder, "lab.toml"))
                subprocess.run(
                    [os.environ["ATOMCAM"], "render", "lab.toml", "-n", "4", "--first", "3", "-o", "frames.npy",
                     "--expected", "means.npy"],
                    cwd=folder, check=True, capture_output=True)
                frames = np.load(os.path.join(folder, "frames.npy"))
                means = np.load(os.path.join(folder, "means.npy"))
                with open(os.path.join(folder, "frames.truth.jsonl")) as lines:
                    notes = [json.loads(line) for line in lines]
            counts, truth = lab.render(4, 3)
            np.testing.assert_array_equal(counts, frames)
            np.testing.assert_array_equal(lab.expected_electrons(5), means[2])
            for n, note in enumerate(notes):
                self.assertEqual(truth.frame[n], note["frame"])
                for name, array in (("initial", truth.present_at_start), ("final", truth.present_at_end)):
                    self.assertEqual("".join(str(int(one)) for one in array[n]), note[name])
                for atom in note["atoms"]:
                    site = atom["site"]
                    self.assertEqual(truth.electrons_detected[n, site], atom["detected_e"])
                    # The text has fewer digits.
                    for name, key, digits in (("loss_time_s", "loss_s", ".6g"), ("x_px", "x_px", ".3f"),
                                              ("y_px", "y_px", ".3f"), ("photons_emitted", "emitted", ".1f"),
                                              ("electrons_expected", "expected_e", ".2f")):
                        value = truth.arrays()[name][n, site]
                        self.assertEqual(float(format(value, digits)), atom.get(key, np.inf), name)

    def test_threads_ranges_and_seeds(self):
        lab = small.lab(**{"seed": 5})
        counts, truth = lab.render(12, threads=1)
        again, same = lab.render(12, threads=5)
        np.testing.assert_array_equal(counts, again)
        for name, array in truth.arrays().items():
            np.testing.assert_array_equal(array, same.arrays()[name], err_msg=name)
        part, some = lab.render(3, 7)
        np.testing.assert_array_equal(part, counts[7:10])
        np.testing.assert_array_equal(some.electrons_detected, truth[7:10].electrons_detected)
        other, _ = lab.render(12, seed=6)
        self.assertFalse((other == counts).all())
        lab["seed"] = 6
        np.testing.assert_array_equal(lab.render(12)[0], other)
        np.testing.assert_array_equal(lab.render(12, seed=5)[0], counts)

    def test_shapes_and_types(self):
        counts, truth = small.lab().render(3)
        self.assertEqual((counts.shape, counts.dtype), ((3, 64, 64), np.uint16))
        for name, array in truth.arrays().items():
            self.assertEqual(array.shape, (3,) if name in ("frame", "shift_x_px", "shift_y_px", "background_e") else (3, 5))
        self.assertEqual(truth.present_at_start.dtype, bool)
        self.assertEqual(truth.electrons_detected.dtype, np.int64)
        self.assertEqual(len(truth), 3)
        np.testing.assert_array_equal(truth.lost, np.isfinite(truth.loss_time_s))
        empty, none = small.lab().render(0)
        self.assertEqual((empty.shape, len(none)), ((0, 64, 64), 0))

    def test_into_memory_of_the_caller(self):
        lab = small.lab()
        counts, _ = lab.render(6)
        with tempfile.TemporaryDirectory() as folder:
            mapped = np.memmap(os.path.join(folder, "counts"), np.uint16, "w+", shape=(6, 64, 64))
            returned, _ = lab.render(3, 0, out=mapped[:3])
            self.assertTrue(np.shares_memory(returned, mapped))
            lab.render(3, 3, out=mapped[3:])
            np.testing.assert_array_equal(mapped, counts)
            del returned, mapped
        locked = np.empty((6, 64, 64), np.uint16)
        locked.flags.writeable = False
        for wrong in (np.empty((6, 64, 64), np.int16), np.empty((5, 64, 64), np.uint16), np.empty((6, 64), np.uint16),
                      np.empty((12, 64, 64), np.uint16)[::2], np.empty((6, 64, 64), np.uint16, order="F"), locked, [1]):
            with self.assertRaises(atomcam.Error):
                lab.render(6, out=wrong)

    def test_nothing_is_copied(self):
        # Rendering into an array touches its pages and, beyond them, next to nothing.
        script = """
import re, small

def kilobytes(what):
    with open("/proc/self/status") as status:
        return int(re.search(what + r":\\s+(\\d+)", status.read())[1])

lab = small.lab()
lab.update({"camera.width_px": 256, "camera.height_px": 256, "atoms.filling": 0.0})
lab.render(2, threads=1)
with open("/proc/self/clear_refs", "w") as peak:
    peak.write("5")  # the highest use so far is forgotten
before = kilobytes("VmRSS")
counts, _ = lab.render(1000, threads=1)
grown = (kilobytes("VmHWM") - before) * 1024
assert counts.nbytes > 1e8 and grown > counts.nbytes * 0.9, "the measure does not see the array"
assert grown < 1.25 * counts.nbytes, (grown, counts.nbytes)
"""
        subprocess.run([sys.executable, "-c", script], check=True, cwd=os.path.dirname(os.path.abspath(__file__)))

    def test_wrong_arguments(self):
        lab = small.lab()
        for arguments, options in [((-1,), {}), ((1.5,), {}), ((1, -3), {}), ((1,), {"threads": 0}), ((1,), {"seed": -1}),
                                   ((1,), {"seed": 2**60}), (("3",), {}), ((2**62,), {"out": np.empty(0, np.uint16)})]:
            with self.assertRaises(atomcam.Error, msg=f"{arguments} {options}"):
                lab.render(*arguments, **options)


class Point(unittest.TestCase):
    def test_the_point_spread_function(self):
        lab = small.lab()
        wide = lab.point_spread_function((201, 201))
        self.assertGreater(wide.sum(), 0.97)
        self.assertLessEqual(wide.sum(), 1 + 1e-6)
        # Shares of finer pixels add up to those of the coarse ones.
        coarse, fine = lab.point_spread_function((15, 11)), lab.point_spread_function((45, 33), oversampling=3)
        np.testing.assert_allclose(fine.reshape(15, 3, 11, 3).sum((1, 3)), coarse, atol=1e-7)
        # Displaced by whole pixels it is the same picture, displaced.
        moved = lab.point_spread_function((201, 201), x_px=3, y_px=-2)
        np.testing.assert_allclose(moved[:-2, 3:], wide[2:, :-3], atol=1e-7)
        # It is what frames are made with: mean light of an atom against its share.
        for wrong in ({"shape": (0, 3)}, {"oversampling": 0}, {"x_px": np.nan}):
            with self.assertRaises(atomcam.Error):
                lab.point_spread_function(**{"shape": (5, 5), **wrong})

    def test_expected_electrons_are_light_times_point_spread_function(self):
        lab = small.lab(**{"light.stray_light_photons_per_s": 0, "atoms.survival": 1})
        lab.sites = [[160, 224]]
        lab.occupancies = [[1]]
        _, truth = lab.render(1)
        share = lab.point_spread_function((64, 64), x_px=0.5, y_px=0.5)  # pixel 32 of the region
        np.testing.assert_allclose(lab.expected_electrons(0), truth.electrons_expected[0, 0] * share, rtol=1e-5, atol=1e-4)


class Threads(unittest.TestCase):
    def test_other_threads_run_while_frames_are_rendered(self):
        lab = small.lab()
        lab.render(1)
        begun, done, ticks = threading.Event(), threading.Event(), 0

        def work():
            begun.set()
            lab.render(20000, threads=1)
            done.set()

        thread = threading.Thread(target=work)
        thread.start()
        begun.wait()
        while not done.is_set():
            time.sleep(0.001)
            ticks += 1
        thread.join()
        self.assertGreater(ticks, 20)  # with the interpreter locked: one or two

    def test_an_interrupt_ends_rendering(self):
        script = """
import signal, small, sys
signal.signal(signal.SIGINT, signal.default_int_handler)  # who runs in the background ignores it
lab = small.lab()
lab.render(1)
print("ready", flush=True)
try:
    lab.render(400000, threads=2)
except KeyboardInterrupt:
    sys.exit(42)
"""
        process = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True,
                                   cwd=os.path.dirname(os.path.abspath(__file__)))
        self.assertEqual(process.stdout.readline().strip(), "ready")
        time.sleep(0.3)
        process.send_signal(signal.SIGINT)
        self.assertEqual(process.wait(timeout=60), 42)
        process.stdout.close()


class Batches(unittest.TestCase):
    def test_are_the_frames_in_order(self):
        lab = small.lab()
        counts, truth = lab.render(10, 4)
        for prefetch in (0, 1, 3):
            got = list(lab.batches(3, 10, first=4, prefetch=prefetch))
            self.assertEqual([len(some) for some, _ in got], [3, 3, 3, 1])
            np.testing.assert_array_equal(np.concatenate([some for some, _ in got]), counts)
            np.testing.assert_array_equal(
                np.concatenate([some.electrons_detected for _, some in got]), truth.electrons_detected)

    def test_shards_share_out_the_frames(self):
        lab = small.lab()
        whole = [some.frame for _, some in lab.batches(2, 11)]
        first = [some.frame for _, some in lab.batches(2, 11, shard=(0, 2))]
        second = [some.frame for _, some in lab.batches(2, 11, shard=(1, 2))]
        self.assertEqual([list(one) for pair in zip(first, second) for one in pair], [list(one) for one in whole])

    def test_without_end_and_given_up(self):
        before = threading.active_count()
        batches = small.lab().batches(4)
        self.assertEqual([list(next(batches)[1].frame) for _ in range(3)], [[0, 1, 2, 3], [4, 5, 6, 7], [8, 9, 10, 11]])
        batches.close()
        self.assertEqual(threading.active_count(), before)

    def test_take_the_lab_as_it_is_at_the_call(self):
        lab = small.lab()
        expected, _ = lab.render(2)
        batches = lab.batches(2, 2)
        lab["camera.em_gain"] = 1
        np.testing.assert_array_equal(next(batches)[0], expected)

    def test_wrong_arguments(self):
        for options in ({"batch": 0}, {"batch": 2, "shard": (2, 2)}, {"batch": 2, "frames": -1}, {"batch": 2, "prefetch": -1}):
            with self.assertRaises(atomcam.Error):
                small.lab().batches(**options)


if __name__ == "__main__":
    unittest.main()
