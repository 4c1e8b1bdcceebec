"""The speed benchmark in a small case: that it runs, and that the hosts it compares do the same."""

import numpy as np
import pytest

from benchmarks import speed

STEPS = 2200  # the master's pace needs two blocks of steps


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("extracted")


def test_hosts_that_are_compared_give_the_same_trajectories(fmus, folder):
    bare = speed.bare_pair(fmus, folder, STEPS)
    assert np.array_equal(speed.master_pair(fmus, STEPS).rows, bare.rows)
    alone = speed.bare_single(fmus[speed.FULL], folder, STEPS)
    assert np.array_equal(alone.rows[:, 0], bare.rows[:, 0])
    assert np.ptp(bare.rows[:, 0]) > 200.0  # the tip-in is in it
    other = speed.libcosim_pair(fmus, STEPS)  # counts time in another way, hence not the same bits
    assert np.abs(other.rows - bare.rows).max() < 1e-6
    assert min(trip.pace for trip in (bare, alone, other)) > 0.0


def test_every_figure_is_printed_with_its_unit(monkeypatch, capsys, fmus):
    monkeypatch.setattr(speed, "build", lambda folder: list(fmus.values()))
    monkeypatch.setattr("sys.argv", ["speed", "--seconds", "2.2", "--repeats", "1"])
    speed.main()
    lines = capsys.readouterr().out.splitlines()
    for name, unit in (("plant_fom, bare FMPy loop", "s/s"), ("both connected, libcosim", "x"),
                       ("largest difference, cosim.master", "N.m"), ("plant_fom, start-up", "s"),
                       ("plant_fom, another instance", "s"), ("in process, simulate()", "1/s"),
                       ("in process, step() of 1 ms", "us")):
        (line,) = [line for line in lines if line.startswith(name + " ")]
        value, printed = line[len(name):].split()[:2]
        assert printed == unit
        assert np.isfinite(float(value)) and float(value) >= 0.0
