"""Cameras that can be exchanged: each setting arrives, none leaks."""

import pickle
import unittest

import numpy as np

import atomcam
import small


class Cameras(unittest.TestCase):
    def test_every_setting_can_be_given_and_arrives(self):
        for made in (atomcam.EMCCDCamera, atomcam.QCMOSCamera):
            for name, value in made().settings().items():
                if isinstance(value, bool):
                    other = not value
                elif isinstance(value, str):
                    # Another choice, or any text where it is free.
                    keys = {p.key: p for p in made()._lab.parameters()}
                    allowed = keys.get(f"camera.{name}", keys.get(f"sensor.{name}")).allowed.split(", ")
                    other = next((one for one in allowed if one != value), "other") if len(allowed) > 1 else "other"
                elif name == "readout_rate_hz":
                    other = 1.7e7
                else:
                    other = next(one for one in (value * 2, value / 2, value + 1, value - 1, 0.5)
                                 if one != value and self.fits(made, name, one))
                camera = made(**{name: other})
                self.assertEqual(getattr(camera, name), other, name)
                lab = atomcam.Lab.preset("ixon-ultra-897")
                lab.camera = camera
                self.assertEqual(getattr(lab.camera, name), other, name)
                self.assertEqual(camera.settings()[name], other)

    @staticmethod
    def fits(made, name, value):
        try:
            made(**{name: value})
        except atomcam.Error:
            return False
        return True

    def test_the_dark_current_law_of_a_qcmos_can_be_set(self):
        """Rate and shape of the gamma law from pixel to pixel, by name at the constructor, show in dark frames."""
        rate, exposure_s, frames = 30.0, 2.0, 40
        for shape in (0.7, 4.0):
            camera = atomcam.QCMOSCamera(
                dark_rate_e_per_s=rate, dark_gamma_shape=shape, dark_reference_c=-20, sensor_temperature_c=-20,
                exposure_s=exposure_s, shutter_open=False, defect_correction=False, columns=512, rows=512,
                offset_x_px=0, offset_y_px=0, width_px=128, height_px=128, offset_sigma_counts=0,
                column_gumbel_counts=0, row_offset_sigma_counts=0, gain_sigma=0, electrons_per_count=1.0)
            lab = small.lab()
            lab.camera = camera
            counts, _ = lab.render(2 * frames)
            light = counts.reshape(2, frames, -1).mean(1) - camera.bias_counts  # two independent means per pixel
            mean, pixels = rate * exposure_s, light.shape[1]
            for half in light:
                self.assertLess(abs(half.mean() - mean), 5 * half.std() / np.sqrt(pixels))
            products = (light[0] - light[0].mean()) * (light[1] - light[1].mean())
            error = products.std() / np.sqrt(pixels)
            self.assertLess(abs(products.mean() - mean**2 / shape), 5 * error, shape)
            # The other shape would be seen.
            self.assertGreater(abs(products.mean() - mean**2 / (4.7 - shape)), 5 * error)

    def test_cameras_inherit_nothing_of_each_other(self):
        first = atomcam.EMCCDCamera(exposure_s=0.5, em_gain=20, quantum_efficiency=0.5)
        second = atomcam.EMCCDCamera()
        self.assertEqual((second.exposure_s, second.em_gain, second.quantum_efficiency), (0.08, 300, 0.86))
        lab, plain = small.lab(), small.lab()
        lab.camera = first
        lab.camera = plain.camera
        self.assertEqual(lab, plain)
        np.testing.assert_array_equal(lab.render(3)[0], plain.render(3)[0])
        first.exposure_s = 0.25
        self.assertEqual((first.exposure_s, second.exposure_s), (0.25, 0.08))

    def test_changes_of_a_labs_camera_are_obeyed(self):
        lab = small.lab(**{"atoms.filling": 1, "atoms.survival": 1, "camera.bias_counts": 200})
        before, _ = lab.render(4)
        lab.camera.bias_counts = 700
        lab.camera.em_gain = 1
        self.assertEqual((lab["camera.bias_counts"], lab["camera.em_gain"]), (700, 1))
        after, _ = lab.render(4)
        self.assertGreater(after.min(), before.min() + 400)
        lab.camera["effects.row_noise"] = 2.5
        self.assertEqual(lab["effects.row_noise"], 2.5)

    def test_exchanged_in_front_of_the_same_atoms(self):
        lab = small.lab(**{"seed": 3, "atoms.filling": 0.5, "effects.blinking": 0.1})
        lab.camera["effects.row_noise"] = 1.0
        _, first = lab.render(20)
        orca = atomcam.QCMOSCamera(columns=512, rows=512, offset_x_px=128, offset_y_px=192, width_px=64, height_px=64)
        lab.camera = orca
        self.assertEqual(lab.kind, "qcmos")
        self.assertIsInstance(lab.camera, atomcam.QCMOSCamera)
        self.assertEqual(lab.camera, orca)
        self.assertEqual((lab["seed"], lab["atoms.filling"], lab["effects.blinking"]), (3, 0.5, 0.1))
        self.assertEqual(lab["effects.row_noise"], orca["effects.row_noise"])
        _, second = lab.render(20)
        np.testing.assert_array_equal(first.present_at_start, second.present_at_start)
        self.assertEqual(pickle.loads(pickle.dumps(lab)), lab)

    def test_errors_name_what_is_allowed(self):
        for make, words in [
            (lambda: atomcam.EMCCDCamera(em_gian=3), "em_gain"),
            (lambda: atomcam.EMCCDCamera(em_gain=1e9), "1 to 1000"),
            (lambda: atomcam.EMCCDCamera(scan="standard"), "EMCCD"),
            (lambda: atomcam.EMCCDCamera(read_noise_e="low"), "low"),
            (lambda: atomcam.EMCCDCamera(electrons_per_count=0), "electrons_per_count"),
            (lambda: atomcam.EMCCDCamera("orca-quest"), "EMCCDCamera"),
            (lambda: atomcam.EMCCDCamera("nothing"), "unknown preset"),
            (lambda: atomcam.EMCCDCamera().__setitem__("atoms.filling", 1), "atoms.filling"),
            (lambda: atomcam.EMCCDCamera().__setitem__("effects.blinking", 0.1), "effects.blinking"),
            (lambda: setattr(atomcam.QCMOSCamera(), "em_gain", 3), "qCMOS"),
        ]:
            with self.assertRaises(atomcam.Error) as caught:
                make()
            self.assertIn(words, str(caught.exception))
        with self.assertRaises(AttributeError):
            atomcam.EMCCDCamera().em_gian
        self.assertIn("em_gain", dir(atomcam.EMCCDCamera()))
        self.assertIn("em_gain=300", repr(atomcam.EMCCDCamera()))


if __name__ == "__main__":
    unittest.main()
