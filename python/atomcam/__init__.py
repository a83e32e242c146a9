"""A virtual camera for neutral-atom laboratories.

>>> import atomcam
>>> lab = atomcam.Lab.preset("ixon-ultra-897")
>>> lab["camera.em_gain"] = 200
>>> counts, truth = lab.render(10)
>>> counts.shape, truth.present_at_start.shape
((10, 256, 256), (10, 306))

`Lab` is where everything starts; `EMCCDCamera` and `QCMOSCamera` can be exchanged in front of the same atoms;
`effects()` lists what can be switched on. `atomcam.dask` renders on a cluster.
"""

from . import _core
from .calibration import Calibration, calibrate
from .cameras import Camera, EMCCDCamera, QCMOSCamera
from .catalogue import Effect, Parameter, effects, presets
from .diagnosis import Diagnosis, diagnose
from .errors import Error
from .judging import Confusion, Detector, Judgement, Share, score
from .lab import Lab
from .truth import Truth

__version__: str = _core.version

__all__ = [
    "Calibration",
    "Camera",
    "Confusion",
    "Detector",
    "Diagnosis",
    "EMCCDCamera",
    "Effect",
    "Error",
    "Judgement",
    "Lab",
    "Parameter",
    "QCMOSCamera",
    "Share",
    "Truth",
    "calibrate",
    "diagnose",
    "effects",
    "presets",
    "score",
]
