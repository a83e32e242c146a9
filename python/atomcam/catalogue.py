"""What can be set: parameters with unit, range and meaning, and the physical effects that have them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from . import _core


@dataclass(frozen=True)
class Parameter:
    """One key of a lab, or one parameter of an effect."""

    key: str  #: with the unit as its last word where it has one
    unit: str  #: "1" for a bare ratio, "" for a text
    meaning: str  #: one sentence
    allowed: str  #: "1 to 1000", or the choices
    source: str  #: where the preset's value comes from; may be empty
    minimum: float  #: inclusive; 0 for a text
    maximum: float  #: inclusive; 0 for a text
    default: float  #: of the preset, or as the effect declares it; 0 for a text
    text: bool  #: a str
    integer: bool  #: an int
    boolean: bool  #: a bool
    logarithmic: bool  #: spans orders of magnitude
    live: bool  #: may change while a camera runs


@dataclass(frozen=True)
class Effect:
    """A physical effect beyond the plain model. Its keys are "effects.<name>.<parameter>"."""

    name: str
    stage: str  #: scene, optics or sensor
    plane: str  #: scene, photons, electrons, register or counts
    summary: str  #: one line
    reference: str  #: where the model comes from
    observables: tuple[str, ...]  #: what it moves
    emccd: bool  #: makes sense on an EMCCD
    qcmos: bool  #: makes sense on a qCMOS
    parameters: tuple[Parameter, ...]  #: the first is the strength: at 0 the effect is absent


def _effect(one: dict[str, Any]) -> Effect:
    members: dict[str, Any] = {
        **one,
        "observables": tuple(one["observables"]),
        "parameters": tuple(Parameter(**parameter) for parameter in one["parameters"]),
    }
    return Effect(**members)


def effects() -> tuple[Effect, ...]:
    """Every effect, in the order in which they apply within a plane."""
    return tuple(_effect(one) for one in _core.effects())


def presets() -> tuple[str, ...]:
    """Names of the presets, for `Lab.preset`."""
    return tuple(_core.preset_names())
