"""Labs: keys, errors, files, copies."""

import copy
import os
import pickle
import tempfile
import threading
import unittest

import numpy as np

import atomcam
import small


class Keys(unittest.TestCase):
    def test_every_key_reads_back_what_was_set(self):
        for preset in atomcam.presets():
            lab = atomcam.Lab.preset(preset)
            before = lab.copy()
            for parameter in lab.parameters():
                value = lab[parameter.key]
                kind = str if parameter.text else bool if parameter.boolean else int if parameter.integer else float
                self.assertIs(type(value), kind, parameter.key)
                lab[parameter.key] = value
                self.assertEqual(lab[parameter.key], value)
                if kind is float and parameter.unit:
                    lab[parameter.key] = parameter.maximum
                    self.assertEqual(lab[parameter.key], parameter.maximum)
                    lab[parameter.key] = value
            self.assertEqual(dict(lab.items()), dict(before.items()))

    def test_numbers_of_numpy_are_numbers(self):
        lab = small.lab()
        lab["camera.em_gain"] = np.float32(12.5)
        self.assertEqual(lab["camera.em_gain"], 12.5)
        lab["seed"] = np.int64(7)
        self.assertEqual(lab["seed"], 7)
        lab["camera.shutter_open"] = np.bool_(False)
        self.assertIs(lab["camera.shutter_open"], False)
        lab["camera.exposure_s"] = np.float64(0.1)
        self.assertEqual(lab["camera.exposure_s"], 0.1)

    def test_errors_name_place_value_and_what_is_allowed(self):
        lab = small.lab()
        before = lab.text()
        for key, value, words in [
            ("sensor.em_gain", 300, ["sensor.em_gain", "camera.em_gain"]),
            ("camera.em_gain", 5000, ["camera.em_gain", "5000", "1 to 1000"]),
            ("camera.em_gain", "much", ["'much'", "1 to 1000"]),
            ("camera.em_gain", float("nan"), ["nan"]),
            ("camera.em_gain", True, ["true"]),
            ("camera.em_gain", None, ["None", "NoneType"]),
            ("camera.em_gain", [300], ["[300]", "list"]),
            ("camera.binning_x", 1.5, ["1.5", "whole numbers"]),
            ("seed", 2**70, ["seed"]),
            ("seed", -1, ["-1"]),
            ("camera.scan", "standard", ["EMCCD"]),
            ("camera.preamp", "9x", ["9x", "1x"]),
            ("camera.shutter_open", "perhaps", ["true or false"]),
        ]:
            with self.assertRaises(atomcam.Error) as caught:
                lab[key] = value
            for word in words:
                self.assertIn(word, str(caught.exception))
            self.assertTrue(caught.exception.place)
            self.assertTrue(str(caught.exception).startswith(caught.exception.place))
        with self.assertRaises(atomcam.Error):
            lab["no.such.key"]
        self.assertEqual(lab.text(), before)
        self.assertTrue(issubclass(atomcam.Error, ValueError))

    def test_update_is_all_or_nothing(self):
        lab = small.lab()
        before = lab.text()
        with self.assertRaises(atomcam.Error):
            lab.update({"camera.em_gain": 100, "atoms.filling": 2})
        self.assertEqual(lab.text(), before)
        lab.update({"camera.em_gain": 100, "atoms.filling": 0.25})
        self.assertEqual((lab["camera.em_gain"], lab["atoms.filling"]), (100, 0.25))

    def test_an_effect_stands_for_its_strength(self):
        lab = small.lab()
        lab["effects.row_noise"] = 0.5
        self.assertEqual(lab["effects.row_noise"], 0.5)
        for effect in atomcam.effects():
            kinds = ["emccd"] * effect.emccd + ["qcmos"] * effect.qcmos
            self.assertTrue(kinds, effect.name)
            keys = atomcam.Lab.preset("ixon-ultra-897" if effect.emccd else "orca-quest").keys()
            for parameter in effect.parameters:
                self.assertIn(f"effects.{effect.name}.{parameter.key}", keys)

    def test_what_does_not_fit_together_is_refused_when_rendered(self):
        lab = small.lab()
        lab["camera.width_px"] = 512
        for refused in (lab.check, lab.render, lambda: lab.batches(3)):
            with self.assertRaisesRegex(atomcam.Error, "region"):
                refused()
        lab["camera.offset_x_px"] = 0
        lab.check()
        self.assertEqual(lab.frame_shape, (64, 512))


class Values(unittest.TestCase):
    def test_files_hold_a_lab_exactly(self):
        lab = small.lab(**{"atoms.filling": 0.1 + 0.2, "effects.row_noise": 1 / 3})
        with tempfile.TemporaryDirectory() as folder:
            for name in ("lab.toml", "lab.json"):
                path = os.path.join(folder, name)
                lab.save(path)
                self.assertEqual(atomcam.Lab.load(path), lab)
            with self.assertRaisesRegex(atomcam.Error, "nowhere.toml"):
                atomcam.Lab.load(os.path.join(folder, "nowhere.toml"))
        self.assertEqual(atomcam.Lab.parse(lab.text()), lab)
        self.assertEqual(atomcam.Lab.parse(lab.text(json=True), json=True), lab)
        with self.assertRaisesRegex(atomcam.Error, "em_gain"):
            atomcam.Lab.parse("[camera]\nem_gian = 3")
        with self.assertRaisesRegex(atomcam.Error, "ixon-ultra-897"):
            atomcam.Lab.preset("ixon")

    def test_copies_are_apart(self):
        lab = small.lab()
        for made in (lab.copy(), copy.copy(lab), copy.deepcopy(lab), pickle.loads(pickle.dumps(lab))):
            self.assertEqual(made, lab)
            made["seed"] = 99
            made.occupancies = [[1, 0, 1, 0, 1]]
            self.assertNotEqual(made, lab)
            self.assertEqual(pickle.loads(pickle.dumps(made)), made)
        self.assertEqual(lab["seed"], 1)

    def test_sites_and_occupancies(self):
        lab = small.lab()
        self.assertEqual(lab.sites.shape, (5, 3))
        self.assertTrue((lab.sites[:, 2] == 1).all())
        self.assertIsNone(lab.occupancies)
        given = np.array([[1, 0, 0, 1, 1], [0, 0, 1, 1, 0]], bool)
        lab.occupancies = given
        np.testing.assert_array_equal(lab.occupancies, given)
        _, truth = lab.render(5)
        np.testing.assert_array_equal(truth.present_at_start, given[[0, 1, 0, 1, 0]])
        for wrong in ([[1, 0, 1]], [1, 0, 0, 1, 1], [[1, 0, 2, 0, 0]], [[256, 0, 0, 0, 0]]):
            with self.assertRaises(atomcam.Error):
                lab.occupancies = wrong
        np.testing.assert_array_equal(lab.occupancies, given)
        for wrong in ([[1, 2, 3, 4]], [1, 2], [[np.nan, 0]], [[0, 0, -1]]):
            with self.assertRaises(atomcam.Error):
                lab.sites = wrong
        lab.occupancies = None
        self.assertIsNone(lab.occupancies)
        lab.sites = [[100, 100, 0.5]]
        np.testing.assert_array_equal(lab.sites, [[100, 100, 0.5]])

    def test_a_lab_may_be_changed_and_rendered_by_several_threads(self):
        lab = small.lab()
        expected = {gain: lab.copy().render(4)[0] for gain in [lab["camera.em_gain"]]}
        other = lab.copy()
        other["camera.em_gain"] = 10
        expected[10] = other.render(4)[0]
        faults = []

        def change():
            for turn in range(20):
                lab["camera.em_gain"] = 10 if turn % 2 else 300

        def render():
            for _ in range(20):
                counts, _ = lab.render(4)
                if not any((counts == one).all() for one in expected.values()):
                    faults.append("a frame of no lab that there was")

        threads = [threading.Thread(target=job) for job in (change, render, render)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        self.assertEqual(faults, [])


class Effects(unittest.TestCase):
    def test_the_catalogue_is_complete(self):
        effects = atomcam.effects()
        self.assertGreater(len(effects), 20)
        for effect in effects:
            self.assertTrue(effect.summary and effect.reference and effect.observables and effect.parameters)
            self.assertIn(effect.stage, ("scene", "optics", "sensor"))
            for parameter in effect.parameters:
                self.assertLess(parameter.minimum, parameter.maximum)
                self.assertTrue(parameter.meaning and parameter.unit and parameter.allowed)


if __name__ == "__main__":
    unittest.main()
