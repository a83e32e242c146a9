"""A laboratory: atoms, optics, sensor, set-points and effects."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from typing import Any, Union

import numpy as np

from . import _core
from .cameras import Camera
from .catalogue import Parameter
from .errors import error
from .truth import Truth

Value = Union[bool, int, float, str]


class Lab:
    """A laboratory, which renders frames with their truth.

    Its keys are those of a lab file and of `--set`: `lab["camera.em_gain"] = 300`. An effect stands for its strength:
    `lab["effects.row_noise"] = 0.5`. What keys decide together (region and binning, say) is checked when frames are
    rendered, or by `check()`. Wrong keys and values raise `atomcam.Error`, which names the nearest key or what is
    allowed, and change nothing.

    Frame n of a lab is always the same, bit for bit: on one thread or many, here, in C, on the command line or through
    the camera. Labs can be copied, compared and pickled.
    """

    _inner: _core.Lab

    def __init__(self, settings: Mapping[str, Value] | None = None, *, preset: str = "ixon-ultra-897") -> None:
        """A preset, with some keys of its own."""
        self._inner = _core.Lab.load(_one_of_the_presets(preset))
        self.update(settings or {})

    @classmethod
    def load(cls, path_or_preset: str | os.PathLike[str]) -> Lab:
        """A lab file (.toml, .json), or a preset by its name."""
        return cls._around(_core.Lab.load(os.fspath(path_or_preset)))

    @classmethod
    def preset(cls, name: str = "ixon-ultra-897") -> Lab:
        """A preset: the camera's figures with the paper's experiment in front of it. `atomcam.presets()` lists them."""
        return cls._around(_core.Lab.load(_one_of_the_presets(name)))

    @classmethod
    def parse(cls, text: str, *, json: bool = False) -> Lab:
        """The text of a lab file, TOML or JSON."""
        return cls._around(_core.Lab.parse(text, json))

    @classmethod
    def _around(cls, core: _core.Lab) -> Lab:
        lab = cls.__new__(cls)
        lab._inner = core
        return lab

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes a lab file, .toml (with comments) or .json."""
        self._inner.save(os.fspath(path))

    def text(self, *, json: bool = False, commented: bool = False) -> str:
        """The text of the lab's file, every key with its value."""
        return self._inner.text(json, commented)

    def copy(self) -> Lab:
        """The same lab again, to be changed apart from this one."""
        return self._around(self._inner.copy())

    # Keys

    def __getitem__(self, key: str) -> Value:
        return self._inner.get(key)

    def __setitem__(self, key: str, value: Value) -> None:
        self._inner.put({key: value})

    def update(self, settings: Mapping[str, Value]) -> None:
        """Sets several keys: all of them, or none if one is refused."""
        self._inner.put(dict(settings))

    def keys(self) -> tuple[str, ...]:
        """Every key of this kind of lab, those of effects that are off included."""
        return tuple(one["key"] for one in self._inner.keys())

    def __iter__(self) -> Iterator[str]:
        return iter(self.keys())

    def __contains__(self, key: object) -> bool:
        return key in self.keys()

    def items(self) -> Iterator[tuple[str, Value]]:
        """Every key with its value."""
        return ((key, self[key]) for key in self.keys())

    def parameters(self) -> tuple[Parameter, ...]:
        """What is known of every key: unit, range, meaning, source of the preset's value."""
        return tuple(Parameter(**one) for one in self._inner.keys())

    def check(self) -> None:
        """Raises `atomcam.Error` if keys do not fit together."""
        self._inner.check()

    # Parts

    @property
    def kind(self) -> str:
        """Of the camera: "emccd" or "qcmos"."""
        return self._inner.kind()

    @property
    def camera(self) -> Camera:
        """The lab's camera. Setting it puts another one in front of the same atoms, light and optics: its sensor, its
        set-points and the effects behind the light."""
        return Camera._of(self)

    @camera.setter
    def camera(self, camera: Camera) -> None:
        self._inner.use_camera(camera._lab._inner)

    @property
    def sites(self) -> np.ndarray[Any, Any]:
        """float64 [site, 3]: x_px, y_px in pixels of the whole sensor, and relative brightness. A copy; set it (also
        [site, 2]) to replace the grid or list."""
        return self._inner.sites()

    @sites.setter
    def sites(self, sites: Any) -> None:
        self._inner.put_sites(np.asarray(sites, np.float64))

    @property
    def occupancies(self) -> np.ndarray[Any, Any] | None:
        """bool [shot, site]: who is filled at the beginning of each shot, used in turn. None: drawn by chance."""
        given = self._inner.occupancies()
        return given if len(given) else None

    @occupancies.setter
    def occupancies(self, occupancies: Any) -> None:
        if occupancies is None:
            self._inner.put_occupancies(np.empty((0, len(self.sites)), np.uint8))
            return
        given = np.asarray(occupancies)
        if not np.isin(given, (0, 1)).all():
            raise error("occupancies", "allowed bool, 0 or 1")
        self._inner.put_occupancies(given.astype(np.uint8))

    @property
    def frame_shape(self) -> tuple[int, int]:
        """Rows and columns of a frame: the region over the binning."""
        return self._inner.frame_shape()

    # Frames

    def render(
        self,
        frames: int = 1,
        first: int = 0,
        *,
        seed: int | None = None,
        threads: int | None = None,
        out: np.ndarray[Any, Any] | None = None,
    ) -> tuple[np.ndarray[Any, Any], Truth]:
        """Renders frames `first` to `first + frames - 1`.

        Parameters
        ----------
        frames : how many.
        first : number of the first one.
        seed : instead of the lab's.
        threads : None for all cores; the frames do not depend on it. Other Python threads run on meanwhile.
        out : uint16 [frame, row, column], contiguous, to render into (shared memory, a `numpy.memmap`); it is what is
            returned. None: a new array.

        Returns
        -------
        counts : uint16 [frame, row, column], digital numbers.
        truth : arrays [frame, site] and [frame], see `Truth`.
        """
        frames, first = _whole("frames", frames, 0, 2**31 - 1), _whole("first", first)
        counts = np.empty((frames, *self.frame_shape), np.uint16) if out is None else out
        truth = Truth.empty(first, frames, len(self.sites))
        self._inner.render_into(counts, truth.arrays(), first, _seed(seed), _threads(threads))
        return counts, truth

    def batches(
        self,
        batch: int,
        frames: int | None = None,
        *,
        first: int = 0,
        seed: int | None = None,
        threads: int | None = None,
        shard: tuple[int, int] = (0, 1),
        prefetch: int = 1,
    ) -> Iterator[tuple[np.ndarray[Any, Any], Truth]]:
        """Batches of frames with their truth, for training loops; the next ones are rendered meanwhile.

        Parameters
        ----------
        batch : frames in a batch; the last one may have less.
        frames : how many in all; None: without end.
        first, seed, threads : as for `render`.
        shard : (index, count): of every `count` batches in turn, this iterator gives number `index`. Processes with
            different indices share out the same frames between them.
        prefetch : batches that are rendered ahead; 0: none, and no thread.

        Yields
        ------
        counts : uint16 [frame, row, column].
        truth : arrays [frame, site] and [frame], see `Truth`.

        The lab is taken as it is at the call; later changes do not show.
        """
        batch, first, prefetch = _whole("batch", batch, 1), _whole("first", first), _whole("prefetch", prefetch)
        index, count = _whole("shard", shard[0]), _whole("shard", shard[1], 1)
        if index >= count:
            raise error("shard", f"{shard}; allowed an index less than the count")
        if frames is not None:
            frames = _whole("frames", frames)
        self.check()
        return self.copy()._batches(batch, frames, first, _seed(seed), _threads(threads), index, count, prefetch)

    def _batches(
        self, batch: int, frames: int | None, first: int, seed: int | None, threads: int, index: int, count: int,
        prefetch: int,
    ) -> Iterator[tuple[np.ndarray[Any, Any], Truth]]:
        from collections import deque
        from concurrent.futures import Future, ThreadPoolExecutor

        def ranges() -> Iterator[tuple[int, int]]:
            begin = index * batch
            while frames is None or begin < frames:
                yield (batch if frames is None else min(batch, frames - begin)), first + begin
                begin += count * batch

        def rendered(some: tuple[int, int]) -> tuple[np.ndarray[Any, Any], Truth]:
            return self.render(*some, seed=seed, threads=threads or None)

        if prefetch == 0:
            yield from map(rendered, ranges())
            return
        ahead: deque[Future[tuple[np.ndarray[Any, Any], Truth]]] = deque()
        with ThreadPoolExecutor(1, "atomcam") as worker:
            try:
                for some in ranges():
                    ahead.append(worker.submit(rendered, some))
                    if len(ahead) > prefetch:
                        yield ahead.popleft().result()
                while ahead:
                    yield ahead.popleft().result()
            finally:
                for waiting in ahead:
                    waiting.cancel()

    def expected_electrons(self, frame: int = 0, *, seed: int | None = None) -> np.ndarray[Any, Any]:
        """float32 [row, column]: expected photo-electrons per pixel of that frame, its atoms as drawn and its stray
        light; without dark current and clock-induced charge."""
        return self._inner.expected_electrons(_whole("frame", frame), _seed(seed))

    def point_spread_function(
        self, shape: tuple[int, int] = (33, 33), *, x_px: float = 0, y_px: float = 0, oversampling: int = 1
    ) -> np.ndarray[Any, Any]:
        """float32 [row, column]: the share of an atom's light on each pixel.

        Parameters
        ----------
        shape : rows and columns of the picture.
        x_px, y_px : where the atom's geometric image stands, in physical pixels from the picture's middle at
            ((columns - 1) / 2, (rows - 1) / 2).
        oversampling : pixels of the picture per physical pixel, along each axis.
        """
        rows, columns = shape
        return self._inner.point_spread_function((rows, columns), x_px, y_px, oversampling)

    # Values

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Lab):
            return NotImplemented
        return self.text() == other.text()

    __hash__ = None  # type: ignore[assignment]

    def __reduce__(self) -> tuple[Any, ...]:
        return _unpickled, (self.text(),)

    def __copy__(self) -> Lab:
        return self.copy()

    def __deepcopy__(self, memo: Any) -> Lab:
        return self.copy()

    def __repr__(self) -> str:
        rows, columns = self.frame_shape
        return f"<Lab {self['name']!r}: {self['sensor.model']}, {len(self.sites)} sites, {columns} x {rows} pixels>"


def _unpickled(text: str) -> Lab:
    return Lab.parse(text)


def _one_of_the_presets(name: str) -> str:
    known = _core.preset_names()
    if name not in known:
        raise error("preset", f"{name!r}; allowed {', '.join(known)}")
    return name


def _whole(name: str, value: Any, minimum: int = 0, maximum: int = 2**63 - 1) -> int:
    try:
        whole = value.__index__()
    except AttributeError:
        raise error(name, f"{value!r}; allowed a whole number") from None
    if not minimum <= whole <= maximum:
        raise error(name, f"{whole}; allowed whole numbers from {minimum} to {maximum}")
    return int(whole)


def _seed(seed: Any) -> int | None:
    return None if seed is None else _whole("seed", seed)


def _threads(threads: Any) -> int:
    """0 for all cores."""
    return 0 if threads is None else _whole("threads", threads, 1, 1024)
