#!/usr/bin/env python3
"""Checks every #include of src/ against the table of floors in docs/architecture.md."""

import pathlib
import re
import sys
import tempfile

ROW = re.compile(r"^\|\s*(\d+)\s*\|\s*`(\w+)`\s*\|.*\|([^|]*)\|\s*$")
INCLUDE = re.compile(r'^\s*#\s*include\s*"([^"]+)"', re.MULTILINE)
SUFFIXES = {".hpp", ".cpp", ".h", ".c", ".inc"}


def floors_of(document):
    """Folder -> (floor, folders it may use), as the table says."""
    floors = {}
    for line in document.splitlines():
        row = ROW.match(line)
        if row:
            floors[row[2]] = (int(row[1]), {word.strip() for word in row[3].split(",") if word.strip()})
    return floors


def table_faults(floors, source):
    faults = []
    folders = {entry.name for entry in source.iterdir() if entry.is_dir()}
    for name in sorted(folders ^ set(floors)):
        faults.append(f"{name}: stands only in {'src' if name in folders else 'the table'}")
    for name, (floor, uses) in floors.items():
        for used in sorted(uses):
            if used not in floors or floors[used][0] >= floor:
                faults.append(f"{name} (floor {floor}): may use {used}, which is not on a floor below")
    return faults


def include_faults(floors, source):
    faults = []
    for path in sorted(source.rglob("*")):
        if path.suffix not in SUFFIXES:
            continue
        own = path.relative_to(source).parts[0]
        allowed = floors[own][1] | {own} if own in floors else set()
        for included in INCLUDE.findall(path.read_text()):
            folder = included.split("/")[0]
            if "/" not in included or folder not in allowed:
                faults.append(f"{path.relative_to(source)}: includes {included}")
    return faults


def planted_faults(floors):
    """The check must see a wrong include, and only that one."""
    with tempfile.TemporaryDirectory() as folder:
        source = pathlib.Path(folder)
        (source / "camera").mkdir()
        (source / "camera" / "good.hpp").write_text('#include "base/image.hpp"\n#include "camera/timing.hpp"\n')
        (source / "camera" / "upwards.hpp").write_text('#include "gige/gvcp.hpp"\n')
        (source / "camera" / "sideways.cpp").write_text('  # include "sensor/sensor.hpp"\n')
        (source / "camera" / "local.cpp").write_text('#include "../base/image.hpp"\n')
        found = include_faults(floors, source)
        expected = [
            "camera/local.cpp: includes ../base/image.hpp",
            "camera/sideways.cpp: includes sensor/sensor.hpp",
            "camera/upwards.hpp: includes gige/gvcp.hpp",
        ]
    return [] if found == expected else [f"planted includes: expected {expected}, found {found}"]


def main():
    root = pathlib.Path(sys.argv[1])
    floors = floors_of((root / "docs" / "architecture.md").read_text())
    source = root / "src"
    faults = table_faults(floors, source) + include_faults(floors, source) + planted_faults(floors)
    for fault in faults:
        print(fault)
    checked = sum(1 for path in source.rglob("*") if path.suffix in SUFFIXES)
    print(f"{checked} files, {len(floors)} floors, {len(faults)} faults")
    return 1 if faults or not checked else 0


if __name__ == "__main__":
    sys.exit(main())
