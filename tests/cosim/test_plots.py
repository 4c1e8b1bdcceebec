"""Pictures show what there is to show: the panels asked for, and no peak lost."""

import numpy as np
import pytest
from matplotlib.figure import Figure

from cosim.master import Result
from cosim.measured import Comparison
from cosim.report import plot_comparison, plot_signals, plots


@pytest.fixture
def drawn(monkeypatch):
    """The figures that were saved."""
    figures = []
    save = Figure.savefig
    monkeypatch.setattr(Figure, "savefig", lambda self, *a, **k: (figures.append(self), save(self, *a, **k)))
    return figures


def test_signals_of_one_name_share_a_panel_with_its_unit(tmp_path, drawn):
    time = np.linspace(0.0, 1.0, 11)
    result = Result(time, {"a.engine_speed": time, "b.engine_speed": 2 * time, "gear": 0 * time + 5},
                    {"a.engine_speed": "rad/s", "b.engine_speed": "rad/s", "gear": "1"})
    path = plot_signals(result, tmp_path / "new" / "x.png", title="T")
    assert path.read_bytes().startswith(b"\x89PNG")
    speed, gear = drawn[0].axes
    assert [line.get_label() for line in speed.lines] == ["a", "b"]
    assert (speed.get_title("left"), gear.get_title("left")) == ("engine speed [rad/s]", "gear")
    assert gear.get_xlabel() == "time [s]"


def test_a_comparison_shows_the_residual_it_speaks_of(tmp_path, drawn):
    time = np.array([0.0, 0.3, 0.4])
    comparison = Comparison("plant.v", "vehicle_speed", "m/s", 3, 1.0, 1.0, 1.0, 0.0, 0.1, 0.2, time,
                            np.zeros(3), np.ones(3))
    plot_comparison([comparison, comparison], tmp_path / "x.png")
    assert len(drawn[0].axes) == 4
    assert drawn[0].axes[1].lines[0].get_ydata().tolist() == [1.0, 1.0, 1.0]
    assert "rms 1 m/s, 10.0 % of the range" in drawn[0].axes[1].get_title("left")


def test_thinning_a_long_signal_keeps_its_peaks(tmp_path, drawn):
    time = np.arange(200_000) / 1000
    values = np.zeros(time.size)
    values[[77_777, 123_456]] = 5.0, -3.0
    plot_signals(Result(time, {"x": values}, {"x": "m"}), tmp_path / "x.png")
    shown = drawn[0].axes[0].lines[0].get_ydata()
    assert shown.size < 4 * plots._POINTS
    assert (shown.max(), shown.min()) == (5.0, -3.0)


def test_dollars_are_shown_as_they_are(tmp_path, drawn):
    """Between two of them matplotlib would read a formula, and fail where it is none."""
    time = np.linspace(0.0, 1.0, 3)
    result = Result(time, {"$a_$.$v_$": time, "b.$v_$": time}, {"$a_$.$v_$": "$u_$", "b.$v_$": "$u_$"})
    assert plot_signals(result, tmp_path / "x.png", title="run $a_$ b").is_file()
    axis, = drawn[0].axes
    assert not any(text.get_text().replace(r"\$", "").count("$") for text in (
        axis.title, drawn[0]._suptitle, *axis.get_legend().get_texts()))


def test_there_is_no_picture_of_nothing(tmp_path):
    assert plot_signals(Result(np.zeros(3), {}, {}), tmp_path / "x.png") is None
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("peak", [0, 7, -1, -5])
def test_no_peak_gets_lost_among_very_many_points(tmp_path, drawn, peak):
    """Nor one behind the last whole stretch."""
    time = np.linspace(0.0, 1.0, 80019)
    values = np.zeros(time.size)
    values[peak] = 100.0
    plot_signals(Result(time, {"v": values}, {"v": "m/s"}), tmp_path / "x.png")
    [line] = drawn[0].axes[0].lines
    assert line.get_ydata().max() == 100.0 and line.get_xdata()[-1] == 1.0
