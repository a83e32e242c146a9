"""Frames rendered on a Dask cluster: a large stack as lazy arrays, one task for each block of frames.

>>> import atomcam, atomcam.dask
>>> lab = atomcam.Lab.preset()
>>> counts, truth = atomcam.dask.render(lab, 100_000, block=500)
>>> counts[:3].mean().compute()                            # renders one block
>>> counts.mean(axis=0).compute()                          # renders all of them, on whatever cluster is in use

Frame n has the same bits as from `lab.render`, wherever it is rendered. atomcam has to be installed on the workers. Dask
itself is not among atomcam's requirements: install `dask[array]`, and `distributed` for a cluster.
"""

from __future__ import annotations

import functools
from importlib import import_module
from typing import Any

import numpy as np

try:
    # As modules without types: whether Dask has some depends on its version.
    _array: Any = import_module("dask.array")
    _delayed: Any = import_module("dask.delayed").delayed
    _tokenize: Any = import_module("dask.base").tokenize
except ImportError as missing:
    raise ImportError("atomcam.dask needs dask[array]: Debian's python3-dask, or from PyPI") from missing

from .lab import Lab, _seed, _whole
from .truth import Truth, layout

__all__ = ["render"]


@functools.lru_cache(maxsize=4)
def _lab_of(text: str) -> Lab:
    """Kept by each worker: a lab's tables are made once, not for every block."""
    return Lab.parse(text)


def _block(text: str, first: int, frames: int, seed: int | None, threads: int) -> dict[str, np.ndarray[Any, Any]]:
    counts, truth = _lab_of(text).render(frames, first, seed=seed, threads=threads)
    return {"counts": counts, **truth.arrays()}


def render(
    lab: Lab, frames: int, first: int = 0, *, block: int = 100, seed: int | None = None, threads: int = 1
) -> tuple[Any, Truth]:
    """Frames `first` to `first + frames - 1` as lazy arrays.

    Parameters
    ----------
    lab : taken as it is now; later changes do not show.
    frames, first, seed : as for `Lab.render`.
    block : frames in a task.
    threads : of each task; a cluster already runs several tasks on each machine.

    Returns
    -------
    counts : dask.array, uint16 [frame, row, column], in chunks of `block` whole frames.
    truth : a `Truth` of dask.arrays [frame, site] and [frame]; `dask.compute(counts, truth.arrays())` computes both at
        once and renders each block once.
    """
    frames, first, block = _whole("frames", frames), _whole("first", first), _whole("block", block, 1)
    threads = _whole("threads", threads, 1, 1024)
    lab.check()
    text = lab.text()
    arguments = (text, _seed(seed), threads)
    sites, kinds = len(lab.sites), layout()
    parts: dict[str, list[Any]] = {"counts": [], **{name: [] for name in kinds}}
    render_block = _delayed(_block, pure=True)
    for begin in range(0, max(frames, 1), block):
        length = min(block, frames - begin)
        name = f"atomcam-render-{_tokenize(arguments, first + begin, length)}"
        rendered = render_block(text, first + begin, length, arguments[1], threads, dask_key_name=name)
        parts["counts"].append(
            _array.from_delayed(rendered["counts"], (length, *lab.frame_shape), np.uint16)
        )
        for key, (kind, axes) in kinds.items():
            parts[key].append(_array.from_delayed(rendered[key], (length, sites)[:axes], kind))
    whole = {name: _array.concatenate(blocks) for name, blocks in parts.items()}
    return whole.pop("counts"), Truth(**whole)
