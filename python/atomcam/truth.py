"""What is true of rendered frames."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True, eq=False)
class Truth:
    """What is true of each atom in each frame; arrays [frame, site] and [frame].

    Positions are in physical pixels of the whole sensor, x along columns, y along rows, origin top left, pixel centres
    at whole numbers; region and binning do not move them. `truth[3]` and `truth[2:5]` are the truth of some frames.
    """

    frame: np.ndarray[Any, Any]  #: uint64 [frame]: the frame's number
    present_at_start: np.ndarray[Any, Any]  #: bool [frame, site]: filled when the exposure begins
    present_at_end: np.ndarray[Any, Any]  #: bool [frame, site]: filled when it ends
    x_px: np.ndarray[Any, Any]  #: float64 [frame, site]: where the atom's geometric image stands
    y_px: np.ndarray[Any, Any]  #: float64 [frame, site]
    loss_time_s: np.ndarray[Any, Any]  #: float64 [frame, site]: since the exposure began; infinity: not lost
    photons_emitted: np.ndarray[Any, Any]  #: float64 [frame, site]: expected, into all directions
    electrons_expected: np.ndarray[Any, Any]  #: float64 [frame, site]: photo-electrons on an endless sensor
    electrons_detected: np.ndarray[Any, Any]  #: int64 [frame, site]: photo-electrons in the region
    shift_x_px: np.ndarray[Any, Any]  #: float64 [frame]: of the whole image, already in x_px
    shift_y_px: np.ndarray[Any, Any]  #: float64 [frame]
    background_e: np.ndarray[Any, Any]  #: float64 [frame]: mean photo-electrons of stray light per physical pixel

    @property
    def lost(self) -> Any:
        """bool [frame, site]: was lost during the exposure."""
        return self.present_at_start & ~self.present_at_end

    def __len__(self) -> int:
        return len(self.frame)

    def __getitem__(self, frames: Any) -> Truth:
        return Truth(*(array[frames] for array in self.arrays().values()))

    def arrays(self) -> dict[str, Any]:
        """The arrays by their names, as for `numpy.savez(file, **truth.arrays())`."""
        return {field.name: getattr(self, field.name) for field in dataclasses.fields(self)}

    @classmethod
    def empty(cls, first: int, frames: int, sites: int) -> Truth:
        """Arrays for this many frames, not yet filled."""
        numbers = np.arange(frames, dtype=np.uint64) + np.uint64(first)
        return cls(numbers, *(np.empty((frames, sites)[:axes], kind) for kind, axes in list(layout().values())[1:]))


def layout() -> dict[str, tuple[Any, int]]:
    """Of each array of a `Truth`: its type and how many axes it has."""
    types: dict[str, Any] = {
        "frame": np.uint64,
        "present_at_start": np.bool_,
        "present_at_end": np.bool_,
        "electrons_detected": np.int64,
    }
    by_frame = {"frame", "shift_x_px", "shift_y_px", "background_e"}
    return {
        field.name: (types.get(field.name, np.float64), 1 if field.name in by_frame else 2)
        for field in dataclasses.fields(Truth)
    }
