"""How well a detector of atoms finds them."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from . import _core
from .errors import error
from .lab import Lab, _whole
from .stacks import Frames, frames_of
from .truth import Truth

__all__ = ["Confusion", "Detector", "Judgement", "Share", "score"]


@dataclass(frozen=True)
class Share:
    """Part of a number."""

    value: float  #: part / number
    error: float  #: one standard error, from the scatter between frames; never below that of independent sites
    part: int
    number: int

    def __str__(self) -> str:
        return f"{self.value:.6g} +- {self.error:.2g}"


@dataclass(frozen=True)
class Confusion:
    """What was said about some of the sites."""

    of: str  #: in words: "120 to 340 electrons"
    start: float  #: of their range
    stop: float  #: infinity: without end
    found: Share | None  #: of the filled sites: called filled; None: there are none
    false_alarms: Share | None  #: of the empty sites: called filled; None: there are none


@dataclass(frozen=True, eq=False)
class Judgement:
    """A detector held against the truth; `atomcam.score` makes it."""

    frames: int
    sites: int
    threshold: float  #: a site whose score is not below it is called filled
    fidelity: Share  #: of all sites in all frames: called rightly
    found: Share  #: of the filled sites: called filled
    false_alarms: Share  #: of the empty sites: called filled
    auc: float  #: area under the curve: of a filled and an empty site, how often the filled one scores higher
    auc_error: float  #: one standard error, after DeLong with frames as clusters
    best_threshold: float  #: with the truth in hand
    best_fidelity: float
    roc: np.ndarray[Any, Any]  #: float64 [point, 3]: threshold, false alarms, found; from (0, 0) to (1, 1)
    by_brightness: tuple[Confusion, ...]  #: filled sites by electrons detected from the atom, in fifths
    by_loss: tuple[Confusion, ...]  #: by the fifth of the exposure in which the atom was lost, and not lost
    by_neighbours: tuple[Confusion, ...]  #: by how many sites next to it are filled
    _found: dict[str, Any] = field(repr=False, compare=False, default_factory=dict)

    def as_dict(self) -> dict[str, Any]:
        """What `atomcam score --json` prints; without the curve."""
        return dict(self._found)

    def __repr__(self) -> str:
        return f"<Judgement of {self.frames} frames of {self.sites} sites: fidelity {self.fidelity}>"


def _share(found: Any) -> Any:
    return None if found is None else Share(**found)


def _rows(rows: Any) -> tuple[Confusion, ...]:
    return tuple(
        Confusion(row["of"], row["from"], np.inf if row["to"] is None else row["to"], _share(row["found"]),
                  _share(row["false_alarms"]))
        for row in rows
    )


def _filled(name: str, truth: Any, filled: str) -> np.ndarray[Any, Any]:
    """bool [..., site]."""
    if filled not in ("start", "end"):
        raise error("filled", f"is {filled!r}; allowed start, end")
    if isinstance(truth, Truth):
        truth = truth.present_at_start if filled == "start" else truth.present_at_end
    table = np.asarray(truth)
    if table.ndim < 2 or table.dtype.kind not in "buif" or not np.isin(table, (0, 1)).all():
        raise error(name, f"{table.dtype} {list(table.shape)}; allowed a Truth, or an array [frame, site] of bool, 0 or 1")
    return table.astype(bool)


def score(
    scores: Any, truth: Truth | Any, lab: Lab | None = None, *, threshold: float = 0.5, filled: str = "start"
) -> Judgement:
    """Holds what a detector says about frames against their truth: `atomcam score` (docs/data.md).

    Parameters
    ----------
    scores : [frame, site] or [shot, image, site], sites in the lab's order: occupancy (bool, 0 or 1), a probability, or
        any number that is larger the likelier the site is filled.
    truth : of these frames, from `Lab.render`; or bool [frame, site] (also [shot, image, site]), which leaves `by_brightness`
        and `by_loss` empty.
    lab : that the frames are of. It gives the exposure and which sites are next to each other; without it `by_loss` and
        `by_neighbours` are empty.
    threshold : a site whose score is not below it is called filled.
    filled : "start": an atom was there when the exposure began; "end": it still was when it ended.

    Every share has one standard error.
    """
    table = np.asarray(scores)
    if table.ndim < 2 or table.dtype.kind not in "buif":
        raise error("scores", f"{table.dtype} {list(table.shape)}; allowed numbers [frame, site] or [shot, image, site]")
    sites = table.shape[-1]
    is_filled = _filled("truth", truth, filled)
    if is_filled.shape[-1] != sites or is_filled.size != table.size:
        raise error("scores", f"shape {list(table.shape)}; the truth has {list(is_filled.shape)}")
    if lab is not None and len(lab.sites) != sites:
        raise error("lab", f"{len(lab.sites)} sites; the scores have {sites}")
    by_site = (-1, sites)
    is_filled = is_filled.reshape(by_site)
    nothing = np.zeros(is_filled.shape)
    lost, loss_time_s, electrons, at_start = nothing, nothing, nothing, is_filled
    if isinstance(truth, Truth):
        at_start = np.asarray(truth.present_at_start)
        lost, loss_time_s, electrons = (
            np.asarray(one) for one in (truth.lost, truth.loss_time_s, truth.electrons_detected))
    neighbours = nothing if lab is None else _core.filled_neighbours(lab._inner, at_start)
    # Judged in float32: a threshold of 0.7 must not part what a float64 of 0.7 becomes.
    cut = float(np.float32(threshold)) if table.dtype != np.float32 else float(threshold)
    text, roc = _core.judge(
        table.reshape(by_site).astype(np.float32), is_filled, lost, loss_time_s, electrons, neighbours, cut,
        1.0 if lab is None else float(lab["camera.exposure_s"]))
    found = json.loads(text)
    found["threshold"] = float(threshold)
    if not isinstance(truth, Truth):
        found["by_brightness"] = []
    if not isinstance(truth, Truth) or lab is None:
        found["by_loss"] = []
    if lab is None:
        found["by_neighbours"] = []
    return Judgement(
        frames=found["frames"], sites=found["sites"], threshold=found["threshold"], fidelity=_share(found["fidelity"]),
        found=_share(found["found"]), false_alarms=_share(found["false_alarms"]), auc=found["auc"]["value"],
        auc_error=found["auc"]["error"], best_threshold=found["best_threshold"], best_fidelity=found["best_fidelity"],
        roc=roc, by_brightness=_rows(found["by_brightness"]), by_loss=_rows(found["by_loss"]),
        by_neighbours=_rows(found["by_neighbours"]), _found=found)


class Detector:
    """A detector to compare others with, the one of `atomcam score --detector`.

    "threshold" sums a square of pixels around each site; "matched" weights these pixels with the lab's point-spread
    function over the variance of the pixel.

    >>> detector = atomcam.Detector("matched", lab)
    >>> detector.teach(counts[::2], truth[::2])
    >>> atomcam.score(detector.scores(counts[1::2]), truth[1::2], lab, threshold=detector.threshold).fidelity
    """

    _inner: _core.Detector

    def __init__(self, kind: str, lab: Lab, *, half_width_px: int | None = None) -> None:
        """For frames of this lab.

        Parameters
        ----------
        kind : "threshold" or "matched".
        lab : with its sites, optics, region and binning; taken as it is now.
        half_width_px : of the square, in pixels of the frames, 1 to 32; None chooses the one that holds three quarters of
            an atom's light.
        """
        if kind not in ("threshold", "matched"):
            raise error("kind", f"is {kind!r}; allowed threshold, matched")
        half_width = 0 if half_width_px is None else _whole("half_width_px", half_width_px, 1, 32)
        self._inner, self._kind = _core.Detector.make(lab._inner, kind, half_width), kind

    def teach(self, frames: Frames, truth: Truth | Any, *, filled: str = "start") -> None:
        """Learns the threshold, and the matched filter the noise.

        Parameters
        ----------
        frames : a path, or counts [frame, row, column] of the lab's frame_shape.
        truth : of these frames, from `Lab.render`, or bool [frame, site].
        filled : "start" or "end", as for `atomcam.score`.
        """
        table = _filled("truth", truth, filled)
        self._inner.teach(frames_of("frames", frames), table.reshape(-1, table.shape[-1]))

    @property
    def threshold(self) -> float:
        """What it has learnt: half way between the two scores that it parts."""
        if not self._inner.taught():
            raise error("detector", "it has not been taught")
        return self._inner.threshold()

    def scores(self, frames: Frames) -> np.ndarray[Any, Any]:
        """float32 [frame, site]: the larger, the likelier the site is filled; counts, summed or weighted."""
        return self._inner.scores(frames_of("frames", frames))

    def __call__(self, frames: Frames) -> np.ndarray[Any, Any]:
        """bool [frame, site]: called filled."""
        occupied: np.ndarray[Any, Any] = self.scores(frames).astype(np.float64) >= self.threshold
        return occupied

    def __repr__(self) -> str:
        return f"<Detector {self._kind!r}{'' if self._inner.taught() else ', not taught'}>"
