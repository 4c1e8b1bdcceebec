"""Pictures, and the page of a diagnosis; the only place that knows matplotlib."""

from cosim.report.plots import plot_comparison, plot_signals

__all__ = ["plot_comparison", "plot_signals"]
