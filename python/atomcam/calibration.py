"""Lab parameters from frames, with errors."""

from __future__ import annotations

import json
import math
import os
from typing import Any

import numpy as np

from . import _core
from .errors import error
from .lab import Lab
from .stacks import Flats, Frames, Notes, Progress, call, flats_in_call, frames_of, levels_of, notes_of, positive, word

__all__ = ["Calibration", "calibrate"]


class Calibration:
    """What a calibration found; `atomcam.calibrate` makes it."""

    _inner: _core.Calibration
    _command: str
    _found: dict[str, Any]

    def __init__(self, inner: _core.Calibration, command: str) -> None:
        self._inner, self._command, self._found = inner, command, json.loads(inner.json())

    @property
    def lab(self) -> Lab:
        """The lab at the fitted values, ready to render; a copy."""
        return Lab._around(self._inner.lab())

    @property
    def parameters(self) -> list[dict[str, Any]]:
        """The table that `atomcam calibrate` prints, a dictionary for each row:

        name : str, a key of the lab, or a product that the frames show as such ("camera.em_gain / electrons_per_count").
        notes : float or None, what was noted; None for what nobody notes.
        fit : float or None.
        error : float or None, one standard error; None: not known, or taken from the notes.
        unit : str, "1" for a bare ratio.
        pull : float or None, (fit - notes) / error.
        from_notes : bool, taken from the notes.
        """
        return [
            {"name": row["key"], "notes": row["noted"], "fit": row["fitted"], "error": row["error"], "unit": row["unit"],
             "pull": row["pull"], "from_notes": row["from_notes"]}
            for row in self._found["parameters"]
        ]

    def __getitem__(self, name: str) -> dict[str, Any]:
        """The row of a parameter."""
        rows = {row["name"]: row for row in self.parameters}
        if name not in rows:
            raise error("calibration", f"no row {name!r}; allowed {', '.join(rows)}")
        return rows[name]

    @property
    def sites(self) -> np.ndarray[Any, Any]:
        """float64 [site, 2]: x_px, y_px, column and row in pixels of the frames; none if the notes have no site_grid.
        `lab.sites` has the same places in pixels of the whole sensor."""
        return self._inner.sites()

    @property
    def site_error_px(self) -> float:
        """One standard error of a place in the middle of the sites, pixels; along x and y alike."""
        return self._inner.position_error_px()

    @property
    def site_brightness(self) -> np.ndarray[Any, Any] | None:
        """float64 [site, 2]: brightness relative to the mean, and its standard error. None without model="full"."""
        sites = self._found.get("site_brightness")
        if sites is None:
            return None
        values = [[math.nan if one[key] is None else one[key] for key in ("brightness", "error")] for one in sites]
        return np.array(values, np.float64).reshape(-1, 2)

    @property
    def maps(self) -> dict[str, np.ndarray[Any, Any]]:
        """float64 [row, column] each, in counts: "offset_counts", "noise_counts" (in time, rms) and their errors
        "offset_error_counts", "noise_error_counts". Empty without model="full" and darks."""
        return self._inner.maps()

    @property
    def goodness_of_fit(self) -> list[dict[str, Any]]:
        """Of each fit to a histogram or image: `fit` (which), `chi_square`, `points`."""
        return list(self._found["goodness_of_fit"])

    @property
    def warnings(self) -> list[str]:
        """What may be wrong with it."""
        return list(self._found["warnings"])

    def as_dict(self) -> dict[str, Any]:
        """What calibration.json holds (docs/calibration.md)."""
        found: dict[str, Any] = json.loads(self._inner.json())
        return found

    def write_report(self, directory: str | os.PathLike[str]) -> None:
        """Writes report.html, calibration.json and, of the full model, the maps as .npy into a folder, which is made.
        The frames are gone through once more: an array has to be as it was."""
        self._inner.write(os.fspath(directory), self._command)

    def __repr__(self) -> str:
        fitted = sum(row["error"] is not None for row in self.parameters)
        return f"<Calibration: {fitted} parameters with errors, {len(self.sites)} sites>"


def calibrate(
    frames: Frames,
    notes: Notes,
    darks: Frames | None = None,
    background: Frames | None = None,
    flats: Flats | None = None,
    model: str = "plain",
    *,
    background_exposure_s: float | None = None,
    progress: Progress | None = None,
) -> Calibration:
    """A lab whose simulation matches frames, with errors: `atomcam calibrate` (docs/calibration.md).

    Parameters
    ----------
    frames : of the atoms: a path, or counts [frame, row, column]. uint16 is not copied, whatever its strides; other
        types are, and must hold whole numbers from 0 to 65535. 8 frames or more.
    notes : what was written down about the set-up: a path (TOML or JSON), or a dictionary of the same form.
    darks : shutter closed, same settings.
    background : shutter open, no atoms.
    flats : evenly lit stacks at several levels, same settings; they need darks. A dictionary has the exposure of each as
        its key, in any unit, which also gives the linearity.
    model : "plain", or "full": also serial clock-induced charge, the brightness of each site, maps of pixels.
    background_exposure_s : of the background, in seconds, if not that of the frames.
    progress : called with (step, fraction done) on the calling thread; what it raises ends the work.

    Other Python threads run meanwhile, and Ctrl-C ends it.
    """
    if model not in ("plain", "full"):
        raise error("model", f"is {model!r}; allowed: plain, full")
    seconds = positive("background_exposure_s", background_exposure_s)
    levels, exposures = levels_of(flats)
    inner = _core.calibrate(
        frames_of("frames", frames),
        notes_of(notes),
        None if darks is None else frames_of("darks", darks),
        None if background is None else frames_of("background", background),
        seconds,
        [frames_of(f"flats[{n}]", one) for n, one in enumerate(levels)],
        exposures,
        model == "full",
        progress,
    )
    in_call = {
        "frames": word(frames), "notes": word(notes), "darks": word(darks), "background": word(background),
        "flats": flats_in_call(levels, exposures), "model": model if model != "plain" else None,
        "background_exposure_s": background_exposure_s,
    }
    return Calibration(inner, call("calibrate", in_call))
