"""Cameras that can be exchanged in front of the same atoms."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar

from ._core import Error
from .errors import error

if TYPE_CHECKING:
    from .lab import Lab, Value

_TABLES = ("camera", "sensor")


class Camera:
    """A sensor with its serial number and its set-points.

    Settings are attributes, by the last word of their keys: `camera.em_gain` is the lab's "camera.em_gain",
    `camera.quantum_efficiency` its "sensor.quantum_efficiency"; `camera.electrons_per_count` and `camera.read_noise_e`
    are those of the readout mode in force. `settings()` lists them. Effects that belong to the camera (row noise, hot
    pixels, serial clock-induced charge: whatever comes behind the light) are set by their keys,
    `camera["effects.row_noise"] = 0.5`.

    `lab.camera` is the camera of a lab, and settings of it are settings of the lab. `lab.camera = other` puts another
    one there: the lab then has the same settings as `other`, and its own atoms, light and optics.
    """

    _preset: ClassVar[str] = "ixon-ultra-897"
    _lab: Lab

    def __init__(self, preset: str | None = None, **settings: Value) -> None:
        """A camera with the figures of a preset (or of a lab file), and some settings of its own."""
        from .lab import Lab

        lab = Lab.load(self._preset if preset is None else preset)
        if type(self) is not Camera and lab.kind != KINDS_OF[type(self)]:
            raise error("preset", f"{preset!r} has another kind of camera than {type(self).__name__}")
        object.__setattr__(self, "_lab", lab)
        # The readout mode's figures last: other settings choose the mode.
        for name in sorted(settings, key=self._is_readout_figure):
            setattr(self, name, settings[name])

    @staticmethod
    def _of(lab: Lab) -> Camera:
        camera: Camera = object.__new__(EMCCDCamera if lab.kind == "emccd" else QCMOSCamera)
        object.__setattr__(camera, "_lab", lab)
        return camera

    def _key(self, name: str) -> str:
        keys = self._lab.keys()
        for table in _TABLES:
            if f"{table}.{name}" in keys:
                return f"{table}.{name}"
        return f"camera.{name}"  # which is refused with the nearest key

    def _own(self, key: str) -> str:
        table, _, rest = key.partition(".")
        if table == "effects":
            from .catalogue import effects

            effect = rest.partition(".")[0]
            if any(one.name == effect and one.stage != "sensor" for one in effects()):
                raise error("camera", f"{key!r} acts before the camera; set it on the lab")
        elif table not in _TABLES:
            raise error("camera", f"{key!r} is no setting of a camera; allowed camera.*, sensor.*, effects.*")
        return key

    def _is_readout_figure(self, name: str) -> bool:
        return name in self._lab._inner.readout_mode()

    def __getattr__(self, name: str) -> Value:
        if name.startswith("_"):
            raise AttributeError(name)
        if self._is_readout_figure(name):
            return self._lab._inner.readout_mode()[name]  # type: ignore[no-any-return]
        try:
            return self._lab[self._key(name)]
        except Error as refused:
            raise AttributeError(str(refused)) from None

    def __setattr__(self, name: str, value: Value) -> None:
        if self._is_readout_figure(name):
            self._lab._inner.put_readout_figure(name, value)
        else:
            self._lab[self._key(name)] = value

    def __getitem__(self, key: str) -> Value:
        return self._lab[self._own(key)]

    def __setitem__(self, key: str, value: Value) -> None:
        self._lab[self._own(key)] = value

    def settings(self) -> dict[str, Value]:
        """Every setting by its name."""
        keys = [key for key in self._lab.keys() if key.partition(".")[0] in _TABLES]
        return {key.partition(".")[2]: self._lab[key] for key in keys} | self._lab._inner.readout_mode()

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self.settings()]

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Camera):
            return NotImplemented
        return self._alone() == other._alone()

    __hash__ = None  # type: ignore[assignment]

    def _alone(self) -> Lab:
        """The camera before atoms, light and optics that are the same for all."""
        from .lab import Lab

        lab = Lab.preset("ixon-ultra-897")
        lab.camera = self
        return lab

    def __repr__(self) -> str:
        shown: dict[str, Any] = self.settings()
        words = ", ".join(f"{name}={shown[name]!r}" for name in ("model", "serial", "exposure_s", "em_gain") if name in shown)
        return f"<{type(self).__name__} {words}>"


class EMCCDCamera(Camera):
    """An EMCCD; without further settings the preset "ixon-ultra-897"."""

    _preset = "ixon-ultra-897"


class QCMOSCamera(Camera):
    """A qCMOS; without further settings the preset "orca-quest"."""

    _preset = "orca-quest"


KINDS_OF = {EMCCDCamera: "emccd", QCMOSCamera: "qcmos"}
