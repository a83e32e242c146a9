"""The type stub of the compiled part says what the module has, and the package is typed throughout."""

import ast
import inspect
import os
import re
import subprocess
import sys
import unittest

import atomcam
from atomcam import _core

PACKAGE = os.path.dirname(atomcam.__file__)


def written(body):
    """Name -> parameters (None for what is no function) of a stub's classes and functions."""
    found = {}
    for node in body:
        if isinstance(node, ast.ClassDef):
            found[node.name] = None
            found.update({f"{node.name}.{name}": value for name, value in written(node.body).items()})
        elif isinstance(node, ast.FunctionDef):
            found[node.name] = [argument.arg for argument in node.args.args]
        elif isinstance(node, ast.AnnAssign):
            found[node.target.id] = None
    return found


def existing(holder, prefix=""):
    """The same of the module, by the first line of what pybind11 says of a function."""
    found = {}
    for name, value in vars(holder).items():
        if name.startswith("_"):
            continue
        if isinstance(value, staticmethod):
            value = value.__func__
        if inspect.isclass(value):
            found[name] = None
            found.update(existing(value, f"{name}."))
        elif callable(value):
            inside = re.match(r"\w+\((.*)\) -> ", value.__doc__.splitlines()[0])[1]
            found[prefix + name] = re.findall(r"(?:^|, )(\w+): ", inside)
        else:
            found[prefix + name] = None
    return found


class Stubs(unittest.TestCase):
    def test_names_and_parameters(self):
        with open(os.path.join(PACKAGE, "_core.pyi")) as stub:
            stated = written(ast.parse(stub.read()).body)
        stated.pop("Error.place")  # of its instances
        there = existing(_core)
        self.assertGreater(len(there), 20)
        self.assertEqual(stated, there)

    def test_the_check_sees_a_difference(self):
        stated = written(ast.parse("class Lab:\n    def load(self, file: str) -> Lab: ...").body)
        self.assertNotEqual(stated["Lab.load"], existing(_core)["Lab.load"])

    def test_every_public_name_is_annotated_and_described(self):
        self.assertTrue(os.path.exists(os.path.join(PACKAGE, "py.typed")))
        for name in atomcam.__all__:
            value = getattr(atomcam, name)
            self.assertTrue(value.__doc__, name)
            members = vars(value).items() if inspect.isclass(value) else [(name, value)]
            for member, function in members:
                function = getattr(function, "__func__", getattr(function, "fget", function))
                if member.startswith("_") or not inspect.isfunction(function):
                    continue
                self.assertTrue(function.__doc__ or member == "keys", f"{name}.{member} is not described")
                signature = inspect.signature(function)
                self.assertIsNot(signature.return_annotation, inspect.Signature.empty, f"{name}.{member}")
                for parameter in list(signature.parameters.values()):
                    if parameter.name not in ("self", "cls"):
                        self.assertIsNot(parameter.annotation, inspect.Parameter.empty, f"{name}.{member}({parameter})")

    def test_mypy(self):
        try:
            import mypy  # noqa: F401
        except ImportError:
            self.skipTest("mypy is not installed")
        found = {} if "site-packages" in PACKAGE else {"MYPYPATH": os.path.dirname(PACKAGE)}
        result = subprocess.run(
            [sys.executable, "-m", "mypy", "--strict", "--cache-dir", os.devnull, "-p", "atomcam"],
            env={**os.environ, **found}, capture_output=True, text=True)
        self.assertEqual(result.returncode, 0, result.stdout + result.stderr)


if __name__ == "__main__":
    unittest.main()
