"""Frames and notes as they are handed to calibration, diagnosis and judging."""

from __future__ import annotations

import hashlib
import json
import math
import os
import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Union

import numpy as np

from . import _core
from .errors import error

__all__ = ["Flats", "Frames", "Notes", "Progress"]

#: Frames of a camera: a stack in a file or folder (docs/data.md), or an array [frame, row, column] of counts. An array of
#: uint16 is read where it lies, whatever its strides; of other types it is checked and converted.
Frames = Union[str, "os.PathLike[str]", np.ndarray[Any, Any]]

#: Evenly lit stacks, one a level of light; as a dictionary with the exposure of each as its key, in any unit.
Flats = Union[Sequence[Frames], Mapping[float, Frames]]

#: What was written down about the set-up (docs/calibration.md): a file, TOML or JSON, or a dictionary.
Notes = Union[str, "os.PathLike[str]", Mapping[str, Any]]

#: Called now and then with the step under way and how much of the whole is done, from 0 to 1.
Progress = Callable[[str, float], Any]


def _is_path(value: Any) -> bool:
    return isinstance(value, (str, os.PathLike))


def frames_of(name: str, frames: Any) -> _core.Frames:
    """`name` is the argument, for errors."""
    if _is_path(frames):
        return _core.Frames.open(os.fspath(frames))
    array = np.asarray(frames)
    if array.ndim != 3:
        raise error(name, f"shape {array.shape}; allowed a path or an array [frame, row, column]")
    return _core.Frames.of_array(array if array.dtype == np.uint16 else _counts(name, array))


def _counts(name: str, array: np.ndarray[Any, Any]) -> np.ndarray[Any, Any]:
    if array.dtype.kind not in "uif":
        raise error(name, f"type {array.dtype}; allowed uint16, or numbers that are counts")
    counts = np.empty(array.shape, np.uint16)
    for n, frame in enumerate(array):
        with np.errstate(invalid="ignore"):
            counts[n] = frame
        wrong = ~((counts[n] == frame) & (frame >= 0) & (frame <= 65535))
        if wrong.any():
            raise error(name, f"frame {n} holds {frame[wrong][0]}; allowed whole numbers from 0 to 65535")
    return counts


def levels_of(flats: Any) -> tuple[list[Any], list[float]]:
    """Stacks, and their exposures; none of these if they are not known."""
    if flats is None:
        return [], []
    if isinstance(flats, Mapping):
        return list(flats.values()), [positive("flats: exposure", one) for one in flats]
    if _is_path(flats):
        raise error("flats", "allowed a list of stacks, or a dictionary with their exposures")
    return list(flats), []


def positive(name: str, value: float | None) -> float:
    """0 for None."""
    if value is None:
        return 0.0
    if not 0 < value < math.inf:
        raise error(name, f"is {value!r}; allowed more than 0")
    return float(value)


def notes_of(notes: Any) -> _core.Notes:
    """Warns of keys that are not understood."""
    if _is_path(notes):
        place = os.fspath(notes)
        made = _core.Notes.read(place)
    elif isinstance(notes, Mapping):
        place = "notes"
        made = _core.Notes.parse(_notes_text(notes), place)
    else:
        raise error("notes", f"of type {type(notes).__name__}; allowed a path or a dictionary")
    for key in made.not_understood():
        warnings.warn(f"{place}: {key}: not understood, left alone", stacklevel=3)
    return made


def _notes_text(notes: Mapping[str, Any]) -> str:
    def plain(value: Any) -> Any:
        if isinstance(value, Mapping):
            return dict(value)
        if isinstance(value, (np.generic, np.ndarray)):
            return value.tolist()
        raise error("notes", f"value {value!r} of type {type(value).__name__}; allowed numbers, texts, lists, dictionaries")

    return json.dumps(dict(notes), default=plain)


def described(role: str, value: Any) -> tuple[str, str, str]:
    """(role, file, SHA-256) for the inputs of a result. The hash of an array is that of its counts, uint16, little endian,
    frame by frame; that of a dictionary is of its JSON text."""
    if _is_path(value):
        return role, os.fspath(value), _core.sha256_of(os.fspath(value))
    if isinstance(value, Mapping):
        return role, "<dictionary>", hashlib.sha256(_notes_text(value).encode()).hexdigest()
    digest = hashlib.sha256()
    for frame in np.asarray(value):
        digest.update(np.ascontiguousarray(frame, "<u2").data)
    return role, in_words(value), digest.hexdigest()


def in_words(value: Any) -> str:
    """As one would write it in a call; an array by its type and shape."""
    if _is_path(value):
        return repr(os.fspath(value))
    if isinstance(value, Mapping):
        return _notes_text(value)
    array = np.asarray(value)
    return f"<{array.dtype} array {list(array.shape)}>"


def call(function: str, arguments: Mapping[str, Any]) -> str:
    """The call that made a result. Arguments that are None or empty are left out."""
    words = [f"{name}={value!r}" for name, value in arguments.items() if value is not None and value != []]
    return f"atomcam.{function}({', '.join(words)})"


class _Word(str):
    """Stands in a call as it is."""

    def __repr__(self) -> str:
        return str(self)


def flats_in_call(levels: list[Any], exposures: list[float]) -> Any:
    """Flats in a call."""
    words = [word(one) for one in levels]
    return dict(zip(exposures, words)) if exposures else words


def word(value: Any) -> _Word | None:
    """Frames or notes in a call."""
    return None if value is None else _Word(in_words(value))
