"""Real frames against simulated ones: where they differ, which effect it is, how far the gap closes."""

from __future__ import annotations

import json
import os
from collections.abc import Iterable
from typing import Any

from . import _core
from .errors import error
from .lab import Lab, _threads, _whole
from .stacks import (
    Flats, Frames, Notes, Progress, call, described, flats_in_call, frames_of, levels_of, notes_of, positive, word,
)

__all__ = ["Diagnosis", "diagnose"]


class Diagnosis:
    """What a diagnosis found; `atomcam.diagnose` makes it. What lists and dictionaries hold is that of diagnosis.json
    (docs/diagnosis.md); each access gives a copy."""

    _inner: _core.Diagnosis

    def __init__(self, inner: _core.Diagnosis) -> None:
        self._inner = inner

    def as_dict(self) -> dict[str, Any]:
        """What diagnosis.json holds."""
        found: dict[str, Any] = json.loads(self._inner.json())
        return found

    @property
    def verdict(self) -> str:
        """"no_gap", "explained", "partly_explained", "unexplained" or "ambiguous"."""
        return str(self.as_dict()["verdict"])

    @property
    def sentence(self) -> str:
        """The diagnosis in one sentence."""
        return str(self.as_dict()["sentence"])

    @property
    def effects(self) -> list[dict[str, Any]]:
        """Found effects: `name`, `stage`, `parameters` {name: {`value`, `error`, `interval`, `unit`}} with one standard
        error and the two ends of it, `probability`, `confusable_with`."""
        return list(self.as_dict()["effects"])

    @property
    def where(self) -> list[dict[str, Any]]:
        """Differences from the plain model, the strongest first: `stage`, `observable`, `statistic`, `axis`, `place`, `z`
        (standard deviations of simulated stacks), `q` (false discovery rate over all of them), `z_after` (with the
        found effects)."""
        return list(self.as_dict()["where"])

    @property
    def gap(self) -> dict[str, Any]:
        """How far it closes: `before`, `after`, `floor` (simulation against simulation), `closed` with
        `closed_interval`, `by_observable`, `steps` per effect, and by which `metric`."""
        return dict(self.as_dict()["gap"])

    @property
    def unexplained(self) -> dict[str, Any]:
        """What remains: `present`, `stage`, `looks_like`."""
        return dict(self.as_dict()["unexplained"])

    @property
    def hypotheses(self) -> list[dict[str, Any]]:
        """What was tried: `effects`, `log_evidence`, `share` (of the misfit, as the scan sees it), `p_value` and
        `closed` (None: not fitted), `why_not`."""
        return list(self.as_dict()["hypotheses"])

    @property
    def calibration(self) -> list[dict[str, Any]]:
        """Of the plain model, a dictionary for each row: `key`, `unit`, `noted`, `fitted`, `error`, `pull`,
        `from_notes`."""
        return list(self.as_dict()["calibration"])

    @property
    def next_measurement(self) -> list[str]:
        """What would tell more."""
        return list(self.as_dict()["next_measurement"])

    @property
    def lab(self) -> Lab:
        """The calibrated lab with the found effects, ready to render; a copy."""
        return Lab._around(self._inner.lab())

    @property
    def plain_lab(self) -> Lab:
        """The calibrated lab without them; a copy."""
        return Lab._around(self._inner.plain_lab())

    def write(self, directory: str | os.PathLike[str], *, progress: Progress | None = None) -> None:
        """Writes diagnosis.json, lab.toml and report.html into a folder, which is made. The frames are gone through once
        more (an array has to be as it was), and stacks are simulated for the report's figures."""
        self._inner.write(_folder("directory", directory), progress)

    def __repr__(self) -> str:
        return f"<Diagnosis {self.verdict!r}: {self.sentence}>"


def _folder(name: str, directory: str | os.PathLike[str]) -> str:
    folder = os.fspath(directory)
    if not folder:
        raise error(name, "''; allowed a path")
    return folder


def _names(name: str, effects: Iterable[str]) -> list[str]:
    if isinstance(effects, str):
        raise error(name, f"{effects!r}; allowed a list of effects")
    return [str(one) for one in effects]


def diagnose(
    frames: Frames,
    notes: Notes,
    darks: Frames | None = None,
    exclude: Iterable[str] = (),
    include: Iterable[str] = (),
    seed: int = 1,
    threads: int | None = None,
    where_only: bool = False,
    progress: Progress | None = None,
    out: str | os.PathLike[str] | None = None,
    *,
    background: Frames | None = None,
    flats: Flats | None = None,
    background_exposure_s: float | None = None,
    against: Frames | None = None,
    cache: str | os.PathLike[str] | None = None,
    all_frames: bool = False,
) -> Diagnosis:
    """Where frames differ from their simulation, and which effect it is: `atomcam diagnose` (docs/diagnosis.md).

    Parameters
    ----------
    frames : of the atoms: a path, or counts [frame, row, column]. uint16 is not copied, whatever its strides; other
        types are, and must hold whole numbers from 0 to 65535. 40 frames or more.
    notes : what was written down about the set-up: a path (TOML or JSON), or a dictionary of the same form.
    darks : shutter closed, same settings.
    exclude : names of effects that are not looked for.
    include : if there are any: effects that are looked for, and no others.
    seed : of the simulations.
    threads : None for all cores; the result does not depend on it.
    where_only : say where the gap lies, look for no effects.
    progress : called with (step, fraction done) on the calling thread; what it raises ends the work.
    out : folder for diagnosis.json, lab.toml and report.html, as by `Diagnosis.write`. None: nothing is written.

    background : shutter open, no atoms.
    flats : evenly lit stacks at several levels, same settings; they need darks. A dictionary has the exposure of each as
        its key, in any unit.
    background_exposure_s : of the background, in seconds, if not that of the frames.
    against : another stack, of 16 frames or more, to compare the frames with in the place of their simulation: before and
        after a change of the set-up. Effects are not looked for.
    cache : folder that keeps what was simulated, for the next diagnosis of the same frames, which is then quicker; at most
        4 GiB. None: nothing is kept.
    all_frames : look at every frame, also of a long stack of large ones, of which 64 or more are looked at (17 million
        pixels), in stretches over the whole stack. Takes longer by as much.

    It takes minutes, with `where_only` seconds. Other Python threads run meanwhile, and Ctrl-C ends it; then nothing is
    written.
    """
    exclude, include = _names("exclude", exclude), _names("include", include)
    seed, cores = _whole("seed", seed), _threads(threads)
    if against is not None and (exclude or include):
        raise error("against", "compares two stacks without any effects: exclude and include are not allowed")
    seconds = positive("background_exposure_s", background_exposure_s)
    levels, exposures = levels_of(flats)
    stacks = {"frames": frames, "darks": darks, "background": background,
              **{f"flats_{n + 1}": one for n, one in enumerate(levels)}, "against": against}
    inputs: list[tuple[str, str, str, _core.Frames | None]] = []
    for role, stack in stacks.items():
        if stack is not None:
            opened = frames_of(role, stack)
            inputs.append((*described(role, stack), opened))
    written = notes_of(notes)
    inputs.append((*described("notes", notes), None))
    folder = "" if out is None else _folder("out", out)
    in_call = {
        "frames": word(frames), "notes": word(notes), "darks": word(darks), "background": word(background),
        "flats": flats_in_call(levels, exposures), "background_exposure_s": background_exposure_s,
        "against": word(against), "exclude": exclude, "include": include, "seed": seed, "where_only": where_only or None,
        "all_frames": all_frames or None, "out": folder or None,
    }
    return Diagnosis(_core.diagnose(
        inputs, written, seconds, exposures, exclude, include, seed, cores, bool(where_only), bool(all_frames),
        "" if cache is None else _folder("cache", cache), call("diagnose", in_call), folder, progress))
