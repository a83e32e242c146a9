"""Installs into an empty folder and uses what is there as a stranger would: the command, the C example by pkg-config
and by CMake. Also: the library shows the names of its header and no others."""

import os
import re
import shutil
import subprocess
import tempfile
import unittest

ROOT = os.path.dirname(os.path.dirname(os.path.dirname(os.path.abspath(__file__))))
BUILD = os.environ["BUILD"]
CMAKE = os.environ["CMAKE"]


def run(*command, **options):
    result = subprocess.run(command, capture_output=True, text=True, **options)
    assert result.returncode == 0, f"{command}: {result.stdout}{result.stderr}"
    return result.stdout


def sanitized():
    with open(os.path.join(BUILD, "CMakeCache.txt")) as cache:
        return re.search(r"^ATOMCAM_SANITIZE:\w+=(.+)$", cache.read(), re.M) is not None


class Install(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.mkdtemp()
        cls.addClassCleanup(shutil.rmtree, cls.folder)
        cls.prefix = os.path.join(cls.folder, "prefix")
        run(CMAKE, "--install", BUILD, "--prefix", cls.prefix)
        (pc,) = [os.path.join(at, name) for at, _, names in os.walk(cls.prefix) for name in names
                 if name == "atomcam.pc"]
        cls.environment = {**os.environ, "PKG_CONFIG_PATH": os.path.dirname(pc), "CMAKE_PREFIX_PATH": cls.prefix,
                           "LD_LIBRARY_PATH": os.path.dirname(os.path.dirname(pc))}
        cls.libraries = cls.environment["LD_LIBRARY_PATH"]
        cls.example = os.path.join(cls.prefix, "share", "doc", "atomcam", "examples", "c")

    def test_the_command_runs(self):
        self.assertIn("ixon-ultra-897", run(os.path.join(self.prefix, "bin", "atomcam"), "lab", "--help"))

    def test_the_library_shows_the_names_of_its_header_only(self):
        with open(os.path.join(self.prefix, "include", "atomcam.h")) as header:
            declared = set(re.findall(r"\b(atomcam_\w+)\(", header.read()))
        names = run("nm", "-D", "--defined-only", os.path.join(self.libraries, "libatomcam.so"))
        shown = {line.split()[-1].split("@")[0] for line in names.splitlines()}
        self.assertGreater(len(declared), 20)
        self.assertEqual(shown - {"ATOMCAM_0"}, declared)

    def test_no_name_was_taken_away(self):
        with open(os.path.join(os.path.dirname(os.path.abspath(__file__)), "names_0.txt")) as kept:
            promised = set(kept.read().split())
        names = run("nm", "-D", "--defined-only", os.path.join(self.libraries, "libatomcam.so"))
        shown = dict(line.split()[-1].split("@")[:: 2] for line in names.splitlines() if "@@" in line)
        self.assertGreater(len(promised), 20)
        self.assertEqual({name: "ATOMCAM_0" for name in promised}, {name: shown.get(name) for name in promised})

    @unittest.skipIf(sanitized(), "a program without sanitizers cannot load a library with them")
    def test_the_program_of_the_documents(self):
        with open(os.path.join(ROOT, "docs", "c.md")) as document:
            (body,) = re.findall(r"```c\n(.*?)```", document.read(), re.S)
        source = os.path.join(self.folder, "shown.c")
        with open(source, "w") as stream:
            stream.write("#include <atomcam.h>\n#include <stdio.h>\n#include <stdlib.h>\nint main(void) {\n" + body
                         + 'printf("%d %d\\n", (int)counts[0] > 0, (int)filled[0] <= 1);\nreturn 0;\n}\n')
        flags = run("pkg-config", "--cflags", "--libs", "atomcam", env=self.environment).split()
        program = os.path.join(self.folder, "shown")
        run("cc", "-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", source, *flags, "-o", program)
        self.assertEqual(run(program, env=self.environment), "1 1\n")

    @unittest.skipIf(sanitized(), "a program without sanitizers cannot load a library with them")
    def test_the_example_by_pkg_config(self):
        flags = run("pkg-config", "--cflags", "--libs", "atomcam", env=self.environment).split()
        program = os.path.join(self.folder, "frames")
        run("cc", "-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", os.path.join(self.example, "frames.c"),
            *flags, "-o", program)
        self.says_what_it_should(program)

    @unittest.skipIf(sanitized(), "a program without sanitizers cannot load a library with them")
    def test_the_example_by_cmake(self):
        build = os.path.join(self.folder, "example")
        run(CMAKE, "-S", self.example, "-B", build, env=self.environment)
        run(CMAKE, "--build", build, env=self.environment)
        self.says_what_it_should(os.path.join(build, "frames"))

    @unittest.skipIf(sanitized(), "a program without sanitizers cannot load a library with them")
    def test_the_header_is_cpp_too(self):
        source = os.path.join(self.folder, "header.cpp")
        with open(source, "w") as stream:
            stream.write("#include <atomcam.h>\nint main() { return atomcam_version()[0] == 0; }\n")
        flags = run("pkg-config", "--cflags", "--libs", "atomcam", env=self.environment).split()
        program = os.path.join(self.folder, "header")
        run("c++", "-Wall", "-Wextra", "-pedantic", "-Werror", source, *flags, "-o", program)
        run(program, env=self.environment)

    def says_what_it_should(self, program):
        said = run(program, env=self.environment)
        right = re.search(r"20 frames of 256 x 256 pixels, 306 sites; .* ([\d.]+) %", said)
        self.assertIsNotNone(right, said)
        self.assertGreater(float(right[1]), 90, said)  # sites looked for at wrong places: 50
        refused = subprocess.run([program, "nowhere.toml"], env=self.environment, capture_output=True, text=True)
        self.assertEqual(refused.returncode, 2)
        self.assertIn("nowhere.toml", refused.stderr)


if __name__ == "__main__":
    unittest.main()
