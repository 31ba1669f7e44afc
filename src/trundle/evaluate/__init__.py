"""How far an estimated trajectory is from a reference: associate, align, APE, RPE, drift, NEES."""

from trundle.evaluate.alignment import align, align_origin, since_start, transform
from trundle.evaluate.association import Stamps, associate, interpolate
from trundle.evaluate.comparison import Alignment, Comparison, compare
from trundle.evaluate.consistency import nees
from trundle.evaluate.pose_error import PoseErrors, RelativeErrors, ape, rpe
from trundle.evaluate.statistics import Statistics

__all__ = [
    "Alignment",
    "Comparison",
    "PoseErrors",
    "RelativeErrors",
    "Stamps",
    "Statistics",
    "align",
    "align_origin",
    "ape",
    "associate",
    "compare",
    "interpolate",
    "nees",
    "rpe",
    "since_start",
    "transform",
]
