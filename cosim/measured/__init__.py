"""Measurements: files of several kinds, each channel on its own clock, in SI under canonical names."""

from cosim.measured.canonical import CANONICAL, CanonicalSignal
from cosim.measured.compare import Comparison, compare
from cosim.measured.measurement import Channel, Manoeuvre, Measurement, load

__all__ = ["CANONICAL", "CanonicalSignal", "Channel", "Comparison", "Manoeuvre", "Measurement", "compare",
           "load"]
