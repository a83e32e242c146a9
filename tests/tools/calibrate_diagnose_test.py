"""atomcam calibrate and atomcam diagnose from outside: what they write, how they end, what they say about bad
input. The stacks are small and have no atoms where the diagnosis is what takes long."""

import ast
import hashlib
import json
import os
import struct
import subprocess
import tempfile
import unittest
import xml.etree.ElementTree as xml
from array import array

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


CODES = {"<u2": "H", "<f4": "f"}


def load(file):
    """Shape and values of a .npy file."""
    with open(file, "rb") as stream:
        content = stream.read()
    end = 10 + struct.unpack("<H", content[8:10])[0]
    header = ast.literal_eval(content[10:end].decode())
    values = array(CODES[header["descr"]])
    values.frombytes(content[end:])
    return header["shape"], values


def save(file, shape, values, kind="<u2"):
    header = repr({"descr": kind, "fortran_order": False, "shape": tuple(shape)})
    header += " " * (-(len(header) + 11) % 64) + "\n"
    with open(file, "wb") as stream:
        stream.write(b"\x93NUMPY\1\0" + struct.pack("<H", len(header)) + header.encode())
        stream.write(array(CODES[kind], values).tobytes())
    return file


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
        self.assertFalse(os.path.exists(self.path("refused")))

    def spoiled(self, words, values, shape=(48, 40, 40), kind="<u2", notes=None, darks=None):
        """Frames (or, given frames, darks) that cannot be judged: one sentence, and nothing is written."""
        stack = save(self.path("spoiled.npy"), shape, values, kind)
        out = self.path("spoiled_out/deeper")
        stacks = ["--frames", darks, "--darks", stack] if darks else ["--frames", stack]
        self.refused(words, 3, "diagnose", *stacks, "--lab", notes or self.no_sites, "--out", out)
        self.assertFalse(os.path.exists(self.path("spoiled_out")))

    def test_diagnose_refuses_frames_that_cannot_be_judged(self):
        _, plain = load(self.plain)
        pixels = 40 * 40
        self.spoiled(["frames: 9 frames are too few", "10"], plain[:9 * pixels], (9, 40, 40))
        shape, atoms = load(self.render("few_atoms.npy", LAB % 0.6, 39))
        self.spoiled(["frames: 39 frames are too few", "40", "with sites"], atoms, shape, notes=self.notes)
        self.spoiled(["no_sites.json: shape", "40 x 40", "32 rows"], plain[:48 * 32 * 40], (48, 32, 40))
        self.spoiled(["frames: ", "are 65535, the largest: saturated", "0.1 %"], [min(65535, 300 * v) for v in plain])
        self.spoiled(["frames: all 48 frames are the same"], plain[:pixels] * 48)
        self.spoiled(["frames: 48 of 48 frames have one value throughout", "10 %"],
                     [200 + n % 3 for n in range(48) for _ in range(pixels)])
        broken = array("f", plain)
        broken[20 * pixels + 3 * 40 + 4] = float("nan")
        self.spoiled(["spoiled.npy: frame 20: pixel [3, 4] is nan", "65535"], broken, kind="<f4")
        with open(self.plain, "rb") as whole, open(self.path("cut.npy"), "wb") as cut:
            cut.write(whole.read()[:-1000])
        self.refused(["cut.npy: frame 47", "cut off"], 3, "diagnose", "--frames", self.path("cut.npy"), "--lab",
                     self.no_sites, "--out", self.path("cut_out"))

    def test_diagnose_refuses_saturated_atoms_and_sites_without_atoms(self):
        atoms = self.render("atoms.npy", LAB % 0.6, 60)
        shape, values = load(atoms)
        # The full well of the brightest pixels only.
        top = sorted(values)[int(0.985 * len(values))]
        self.spoiled([f"are {top}, the largest: saturated"], [min(v, top) for v in values], shape, notes=self.notes)
        _, plain = load(self.plain)
        self.spoiled(["frames: no light where the notes list 9 sites"], plain, notes=self.notes)

    def test_diagnose_refuses_notes_of_another_camera(self):
        settings = {**NOTES["settings"]}
        del settings["em_gain"]
        other = self.write("other.json", json.dumps({"camera": "ORCA-Quest", "settings": settings, "site_grid": GRID}))
        self.refused(["other.json: settings", "another camera"], 3, "diagnose", "--frames", self.atoms, "--lab", other,
                     "--out", self.path("other"))
        self.assertFalse(os.path.exists(self.path("other")))

    def test_diagnose_refuses_darks_that_are_none(self):
        _, dark = load(self.render("dark.npy", LAB % 0, 40, "--set", "camera.shutter_open=false"))
        pixels = 40 * 40
        self.spoiled(["darks: have 32 rows and 40 columns, the frames 40 and 40"], dark[:40 * 32 * 40], (40, 32, 40),
                     darks=self.plain)
        self.spoiled(["darks: 1 frames are too few", "4"], dark[:pixels], (1, 40, 40), darks=self.plain)
        self.spoiled(["darks: all 40 frames are the same"], [200] * len(dark), (40, 40, 40), darks=self.plain)
        self.spoiled(["darks: have", "counts in the median pixel", "not brighter"], [5 * v for v in dark],
                     (40, 40, 40), darks=self.plain)

    def test_darks_alone_are_welcome(self):
        darks = self.plain_stack("alone.npy", 0.6, 60, "--set", "camera.shutter_open=false")
        result, diagnosis, _ = self.diagnose(darks, "--where-only")
        self.assertEqual((result.returncode, diagnosis["verdict"]), (0, "no_gap"), diagnosis["sentence"])

    def plain_stack(self, name, filling, frames, *more):
        """Of the plain model: the camera's own serial charge is left out."""
        return self.render(name, LAB % filling, frames, "--set", "effects.serial_cic=0", *more)

    def test_background_and_flats_are_taken(self):
        atoms = self.plain_stack("plain_atoms.npy", 0.6, 60)
        darks = self.plain_stack("plain_darks.npy", 0, 40, "--first", "1000", "--set", "camera.shutter_open=false")
        background = self.plain_stack("background.npy", 0, 40, "--first", "300")
        flats = [self.plain_stack(f"flat{level}.npy", 0, 40, "--first", str(400 + level), "--set",
                                  f"light.stray_light_photons_per_s={level}") for level in (100, 300, 600)]
        stacks = ["--darks", darks, "--background", background, "--flats", *flats]
        result, diagnosis, _ = self.diagnose(atoms, *stacks, "--where-only", notes=self.notes)
        self.assertEqual((result.returncode, diagnosis["verdict"]), (0, "no_gap"), diagnosis["sentence"])
        self.assertEqual(len(diagnosis["flats"]["levels"]), 3)
        # Excess noise times gain over electrons per count, of a register: twice what the frames say.
        rows = {row["key"]: row for row in diagnosis["calibration"]}
        by_flats = rows["flats: em_gain / electrons_per_count"]
        by_frames = rows["camera.em_gain / electrons_per_count"]
        self.assertLess(abs(by_flats["fitted"] - by_frames["fitted"]), 5 * (by_flats["error"] + by_frames["error"]))
        for role, frames in (("background", 40), ("flats_1", 40), ("flats_3", 40)):
            self.assertEqual(diagnosis["inputs"][role]["frames"], frames)
        self.assertIn("--background " + background, diagnosis["inputs"]["command"])
        self.assertIn("--flats " + flats[2], diagnosis["inputs"]["command"])
        # The light without atoms is the background's, not what the sites' images leave.
        good("calibrate", "--frames", atoms, "--darks", darks, "--lab", self.notes, "-o", self.path("without.toml"),
             "--report", self.path("without"))
        with open(self.path("without/calibration.json")) as stream:
            without = {row["key"]: row for row in json.load(stream)["parameters"]}
        light = "light.stray_light_photons_per_s x quantum_efficiency x exposure_s"
        self.assertNotEqual(rows[light]["fitted"], without[light]["fitted"])
        self.refused(["flats", "darks"], 3, "diagnose", "--frames", atoms, "--lab", self.notes, "--flats", flats[0],
                     "--out", self.path("x"))

    def test_light_without_atoms_is_welcome(self):
        light = self.plain_stack("light.npy", 0, 48)
        darks = self.plain_stack("its_darks.npy", 0, 48, "--first", "1000", "--set", "camera.shutter_open=false")
        result, diagnosis, _ = self.diagnose(light, "--darks", darks, "--where-only")
        self.assertEqual((result.returncode, diagnosis["verdict"]), (0, "no_gap"), diagnosis["sentence"])

    def test_one_stack_against_another(self):
        result, diagnosis, out = self.diagnose(self.plain, "--against", self.noisy)
        self.assertEqual((result.returncode, diagnosis["verdict"]), (2, "unexplained"), diagnosis["sentence"])
        self.assertEqual(diagnosis["where"][0]["observable"], "row_means")
        self.assertLess(diagnosis["where"][0]["z"], 0)  # the frames have less of it
        self.assertEqual((diagnosis["effects"], diagnosis["hypotheses"]), ([], []))
        self.assertEqual(diagnosis["inputs"]["against"]["frames"], 48)
        words = "".join(self.page(os.path.join(out, "report.html")).itertext())
        self.assertIn("One stack against another", words)
        self.assertIn("--against " + self.noisy, words)
        good("lab", "--check", os.path.join(out, "lab.toml"))
        self.refused(["--against", "--include"], 3, "diagnose", "--frames", self.plain, "--against", self.noisy, "--lab",
                     self.no_sites, "--out", self.path("x"), "--include", "row_noise")
        few = self.render("few.npy", LAB % 0, 12)
        self.refused(["against: 12 frames", "16"], 3, "diagnose", "--frames", self.plain, "--against", few, "--lab",
                     self.no_sites, "--out", self.path("x"))

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
