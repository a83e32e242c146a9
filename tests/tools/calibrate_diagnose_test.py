"""atomcam calibrate and atomcam diagnose from outside: what they write, how they end, what they say about bad
input. The stacks are small and have no atoms where the diagnosis is what takes long."""

import hashlib
import json
import os
import subprocess
import tempfile
import unittest
import xml.etree.ElementTree as xml

ATOMCAM = os.environ["ATOMCAM"]
DATA = os.environ.get("ATOMCAM_DATA")

LAB = """name = "Small"
[camera]
preset = "ixon-ultra-897"
width_px = 40
height_px = 40
binning_x = 1
binning_y = 1
[atoms]
filling = %s
[atoms.grid]
columns = 3
rows = 3
spacing_x_px = 11
spacing_y_px = 11
offset_x_px = 9
offset_y_px = 9
[optics]
magnification = 78.125
[light]
stray_light_photons_per_s = 3
"""

NOTES = {"camera": "iXon Ultra 897", "shape": [40, 40],
         "settings": {"exposure_s": 0.08, "em_gain": 300, "preamp_e_per_adu": 4.5, "bias_adu": 190,
                      "read_noise_adu": 5, "pixel_um": 16, "magnification": 78.125, "cic_e": 0.002}}
GRID = {"rows": 3, "cols": 3, "spacing_px": 10.9, "first_site_px": [9.5, 8.6]}


def run(*arguments):
    return subprocess.run([ATOMCAM, *arguments], capture_output=True, text=True, timeout=500)


def good(*arguments):
    result = run(*arguments)
    if result.returncode:
        raise AssertionError(result.stderr)
    return result


class Commands(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(cls.folder.cleanup)
        cls.notes = cls.write("notes.json", json.dumps({**NOTES, "site_grid": GRID}))
        cls.no_sites = cls.write("no_sites.json", json.dumps(NOTES))
        cls.atoms = cls.render("atoms.tif", LAB % 0.6, 60)
        cls.darks = cls.render("darks.tif", LAB % 0.6, 40, "--first", "1000", "--set", "camera.shutter_open=false")
        cls.plain = cls.render("plain.npy", LAB % 0, 48)
        cls.noisy = cls.render("noisy.npy", LAB % 0, 48, "--set", "effects.row_noise=0.8")

    @classmethod
    def path(cls, name):
        return os.path.join(cls.folder.name, name)

    @classmethod
    def write(cls, name, text):
        with open(cls.path(name), "w") as stream:
            stream.write(text)
        return cls.path(name)

    @classmethod
    def render(cls, name, lab, frames, *more):
        good("render", cls.write("lab_of_" + name + ".toml", lab), "-n", str(frames), "-o", cls.path(name), *more)
        return cls.path(name)

    def refused(self, words, code, *arguments):
        """One clear line and the exit code."""
        result = run(*arguments)
        self.assertEqual(result.returncode, code, result.stderr)
        lines = result.stderr.splitlines()
        self.assertEqual(len(lines), 1, result.stderr)
        self.assertTrue(lines[0].startswith("atomcam"), lines[0])
        for word in words:
            self.assertIn(word, lines[0])

    def page(self, file):
        """Well-formed, and nothing in it that a browser would fetch."""
        with open(file, encoding="utf-8") as stream:
            text = stream.read()
        root = xml.fromstring(text)
        for element in root.iter():
            self.assertNotIn(element.tag, ("script", "link", "iframe", "object", "embed"))
            for name, value in element.attrib.items():
                self.assertNotIn("url(", value)
                if name in ("src", "href"):
                    self.assertTrue(value.startswith("data:"), value[:60])
        self.assertNotRegex(root.find("head/style").text, r"@import|url\(")
        return root

    def diagnose(self, frames, *more, notes=None):
        out = self.path("out_" + self.id().split(".")[-1])
        result = run("diagnose", "--frames", frames, "--lab", notes or self.no_sites, "--out", out, *more)
        self.assertLess(result.returncode, 3, result.stderr)
        with open(os.path.join(out, "diagnosis.json")) as stream:
            return result, json.load(stream), out

    # Calibrating

    def test_calibrate_writes_lab_table_and_report(self):
        lab, report = self.path("lab.toml"), self.path("report")
        table = good("calibrate", "--frames", self.atoms, "--darks", self.darks, "--lab", self.notes, "-o", lab,
                     "--report", report).stdout
        self.assertRegex(table, r"camera\.em_gain / electrons_per_count +66\.6667 +\S+ +\S+ +counts/e")
        self.assertRegex(table, r"sensor\.electrons_per_count +4\.5 +4\.5 +by notes")
        good("lab", "--check", lab)
        good("render", lab, "-n", "2", "-o", self.path("again.npy"))
        with open(os.path.join(report, "calibration.json")) as stream:
            rows = {row["key"]: row for row in json.load(stream)["parameters"]}
        # The notes are wrong by 10 counts, the fit is not.
        bias = rows["camera.bias_counts"]
        self.assertLess(abs(bias["fitted"] - 200), 5 * bias["error"])
        self.assertEqual(bias["noted"], 190)
        root = self.page(os.path.join(report, "report.html"))
        self.assertEqual(len(root.findall(".//table")), 1)
        self.assertIn("--report " + report, "".join(root.itertext()))

    def test_calibrate_refuses(self):
        lab = self.path("x.toml")
        frames, notes = ["--frames", self.atoms], ["--lab", self.notes]
        self.refused(["none.tif"], 2, "calibrate", "--frames", self.path("none.tif"), *notes, "-o", lab)
        self.refused(["none.json"], 2, "calibrate", *frames, "--lab", self.path("none.json"), "-o", lab)
        self.refused(["--model", "fullest", "plain"], 2, "calibrate", *frames, *notes, "-o", lab, "--model", "fullest")
        self.refused(["--output"], 2, "calibrate", *frames, *notes)
        self.refused(["no/such/x.toml"], 2, "calibrate", *frames, *notes, "-o", self.path("no/such/x.toml"))
        shape = self.write("shape.json", json.dumps({**NOTES, "shape": [64, 64]}))
        self.refused(["shape.json: shape", "64 x 64", "40"], 2, "calibrate", *frames, "--lab", shape, "-o", lab)
        self.assertFalse(os.path.exists(lab))

    # Diagnosing

    def test_no_gap_is_exit_code_0(self):
        result, diagnosis, out = self.diagnose(self.plain, "--exclude", "serial_cic", "--include", "row_noise")
        self.assertEqual((result.returncode, diagnosis["verdict"]), (0, "no_gap"), diagnosis["sentence"])
        self.assertEqual(diagnosis["effects"], [])
        self.page(os.path.join(out, "report.html"))

    def test_explained_is_exit_code_1(self):
        result, diagnosis, out = self.diagnose(self.noisy, "--include", "row_noise", "--seed", "5")
        self.assertEqual((result.returncode, diagnosis["verdict"]), (1, "explained"), diagnosis["sentence"])
        self.assertEqual([effect["name"] for effect in diagnosis["effects"]], ["row_noise"])
        self.assertIn(diagnosis["sentence"], result.stdout)
        # The lab that is written has the effect, and renders.
        lab = os.path.join(out, "lab.toml")
        with open(lab) as stream:
            self.assertRegex(stream.read(), r"row_noise")
        good("render", lab, "-n", "1", "-o", self.path("with_effect.npy"))
        root = self.page(os.path.join(out, "report.html"))
        words = "".join(root.itertext())
        self.assertIn(diagnosis["sentence"], words)
        # What is needed to do it again.
        inputs = diagnosis["inputs"]
        with open(self.noisy, "rb") as stream:
            self.assertEqual(inputs["frames"]["sha256"], hashlib.sha256(stream.read()).hexdigest())
        self.assertEqual((inputs["frames"]["frames"], inputs["frames"]["shape"]), (48, [40, 40]))
        self.assertEqual((inputs["seed"], inputs["include"]), (5, ["row_noise"]))
        self.assertIn(inputs["command"], words)
        self.assertEqual(inputs["version"], good("--version").stdout.split()[1])

    def test_unexplained_is_exit_code_2(self):
        result, diagnosis, out = self.diagnose(self.noisy, "--where-only")
        self.assertEqual((result.returncode, diagnosis["verdict"]), (2, "unexplained"), diagnosis["sentence"])
        self.assertEqual(diagnosis["unexplained"]["stage"], "sensor")
        self.assertEqual(diagnosis["where"][0]["observable"], "row_means")
        self.page(os.path.join(out, "report.html"))

    def test_threads_do_not_change_a_diagnosis_but_the_seed_does(self):
        def numbers(*more):
            diagnosis = self.diagnose(self.noisy, "--where-only", *more)[1]
            return [diagnosis[key] for key in ("where", "gap", "calibration")]

        one = numbers("--threads", "1")
        self.assertEqual(one, numbers("--threads", "3"))
        self.assertNotEqual(one, numbers("--threads", "3", "--seed", "2"))

    def test_diagnose_refuses_with_exit_code_3(self):
        frames, notes, out = ["--frames", self.plain], ["--lab", self.no_sites], ["--out", self.path("refused")]
        self.refused(["none.tif"], 3, "diagnose", "--frames", self.path("none.tif"), *notes, *out)
        self.refused(["none.json"], 3, "diagnose", *frames, "--lab", self.path("none.json"), *out)
        self.refused(["row_nois", "catalogue"], 3, "diagnose", *frames, *notes, *out, "--exclude", "row_nois")
        self.refused(["--frames"], 3, "diagnose", *notes, *out)
        self.refused(["--out", "notes.json"], 3, "diagnose", *frames, *notes, "--out", self.notes)
        few = self.render("few.npy", LAB % 0, 12)
        self.refused(["12 frames", "40"], 3, "diagnose", "--frames", few, *notes, *out)
        self.assertFalse(os.path.exists(self.path("refused/diagnosis.json")))

    def test_hash_of_a_folder_of_frames(self):
        os.mkdir(self.path("folder"))
        for n in range(40):
            good("render", self.path("lab_of_plain.npy.toml"), "-n", "1", "--first", str(n), "-o",
                 self.path(f"folder/f{n:02}.tif"))
        _, diagnosis, _ = self.diagnose(self.path("folder"), "--where-only")
        lines = ""
        for n in range(40):
            with open(self.path(f"folder/f{n:02}.tif"), "rb") as stream:
                lines += f"{hashlib.sha256(stream.read()).hexdigest()}  f{n:02}.tif\n"
        self.assertEqual(diagnosis["inputs"]["frames"]["sha256"], hashlib.sha256(lines.encode()).hexdigest())

    @unittest.skipUnless(DATA, "ATOMCAM_DATA is not set: no practice stacks")
    def test_practice_stack_without_effects(self):
        stack = os.path.join(DATA, "practice", "p01")
        result, diagnosis, out = self.diagnose(os.path.join(stack, "frames.tif"), "--darks",
                                               os.path.join(stack, "darks.tif"), "--where-only",
                                               notes=os.path.join(stack, "lab.json"))
        self.assertEqual((result.returncode, diagnosis["verdict"]), (0, "no_gap"), diagnosis["sentence"])
        self.page(os.path.join(out, "report.html"))


if __name__ == "__main__":
    unittest.main()
