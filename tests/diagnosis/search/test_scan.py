"""Starts of fits: on plants of a few lines, whose landscapes are known, and of what a car hides."""

from dataclasses import replace

import numpy as np
import pytest
from floors import measured, shortened
from vibration import DETECTION, Plant, WithStages

from cosim.diagnosis.catalogue import CATALOGUE
from cosim.diagnosis.fit.fitting import Fitter
from cosim.diagnosis.fit.predict import Predictor, coordinates
from cosim.diagnosis.search.scan import LARGE, SMALL, Scan, best_of_each


def scanned(hidden, **limits):
    """A scan, the plant's file as a start, and its noise."""
    fitter = Fitter(Plant(hidden, **limits))
    start = fitter.nominal()
    return Scan(fitter), start, fitter.noise(start)


def test_probes_have_the_sizes_asked_for_and_stay_within_their_limits():
    scan, start, _ = scanned({}, lowest=-0.3)
    probes = scan.probes(start, ["size", "tilt"], (*SMALL, *LARGE))
    sizes = [(fit.causes, float(fit.shared[scan.predictor.index(fit.causes[0])[0]])) for fit in probes]
    assert [x for causes, x in sizes if causes == ("size",)] == pytest.approx([-0.15, 0.15, -0.4, 0.4])
    assert [x for causes, x in sizes if causes == ("tilt",)] == pytest.approx([-0.15, 0.15, 0.4])
    assert all(np.count_nonzero(fit.shared) == 1 for fit in probes)


def test_a_fit_is_tried_with_each_of_its_sizes_larger_and_smaller():
    """Up to what is possible, in all runs alike, and with all else as it is."""
    scan, start, _ = scanned({}, lowest=-0.3)
    places = [scan.predictor.index(cause)[0] for cause in ("size", "tilt", "curve")]
    there = np.zeros(len(start.shared))
    there[places] = 0.5, -0.2, 0.1
    points = [there + 0.01, there - 0.01]
    fit = scan.fitter.placed(start, ("size", "tilt"), there, points)
    others = scan.resized(fit)
    assert all(other.causes == fit.causes for other in others)
    changes = [other.shared - there for other in others]
    assert [change[places[0]] for change in changes[:4]] == pytest.approx([-0.3, -0.15, 0.25, 0.5])  # 1 at most
    assert [change[places[1]] for change in changes[4:]] == pytest.approx([0.12, 0.06, -0.1])  # -0.3 at least, once
    for other, change, place in zip(others, changes, [places[0]] * 4 + [places[1]] * 3):
        assert np.flatnonzero(change).tolist() == [place]
        for point, before in zip(other.points, points):
            assert point[place] == other.shared[place] and np.delete(point - before, place) == pytest.approx(0.0)
    assert not scan.resized(start)


def test_beside_a_start_its_own_causes_are_not_probed():
    scan, start, noise = scanned({})
    beside = replace(start, causes=("size",))
    assert {fit.causes for fit in scan.starts(beside, ["size", "slope"], noise)} == {("size", "slope")}


def test_the_size_of_a_probe_is_looked_for_before_anything_is_fitted():
    """Between the sizes that are tried first, where a fit of everything would end a period off."""
    scan, start, noise = scanned({"phase": 0.25})
    [probe] = scan.probes(start, ["phase"], [1.5])
    sized = scan.sized(start, scan.fitter.assess(probe, noise), noise)
    assert probe.shared[0] == pytest.approx(1.5 * DETECTION)
    assert sized.shared[0] == pytest.approx(0.25, abs=0.02) and not np.any(sized.shared[1:])
    assert sized.hope > probe.hope + 100.0


def test_sizes_that_mean_nothing_alone_are_looked_for_together():
    """A narrow stage, beside which wide ones are worse than none."""
    fitter = Fitter(WithStages({}, stage=0.15, width=0.15))
    start, scan = fitter.nominal(), Scan(fitter)
    noise = fitter.noise(start)
    [probe] = scan.probes(start, ["stages"], [1.5])
    sized = scan.sized(start, fitter.assess(probe, noise), noise)
    assert probe.shared[[3, 4]] == pytest.approx([0.4, 0.2])
    assert sized.shared[[3, 4]] == pytest.approx([0.15, 0.15], rel=0.15) and not np.any(sized.shared[:3])
    assert sized.hope > fitter.assess(start, noise).hope + 100.0 > probe.hope + 200.0


def test_a_short_stiff_stage_of_axle_shafts_is_looked_for_where_it_is(car_and_run):
    """A longer one is worse than none, and so is a softer one, from which nothing shows a way through no stage at all.
    """
    ratio, twist = 1.28, 0.005
    car, run = car_and_run
    run = shortened(run, 4.0)
    tyres = CATALOGUE["tyre_slip"].changes({"slip_stiffness": 0.54}, car.values)
    values = car.values | tyres | CATALOGUE["two_stage_stiffness"].changes(
        {"first_stage_stiffness": ratio, "first_stage_twist": twist}, car.values)
    led = measured(car, run, car.raw(values, run.free))
    fitter = Fitter(Predictor(car, [led], coordinates(car, [led])))
    point = np.zeros(len(fitter.coordinates))
    point[fitter.predictor.index("tyre_slip")] = np.log(0.54)
    start = replace(fitter.at(point), causes=("tyre_slip",))
    noise = fitter.noise(start)
    start = fitter.settle(fitter.assess(fitter.refine(start, noise), noise), noise)
    best = Scan(fitter).starts(start, ["two_stage_stiffness"], noise)[0]
    stiffness, width = (best.shared[i] for i in fitter.predictor.index("two_stage_stiffness"))
    assert stiffness == pytest.approx(np.log(ratio), abs=0.1) and width == pytest.approx(twist, rel=0.4)
    assert best.hope > start.hope + 4.0


def test_gaps_are_changed_by_what_says_so(car_and_run):
    car, run = car_and_run
    scan = Scan(Fitter(Predictor(car, [run], coordinates(car, [run]))))
    assert set(scan.gaps(CATALOGUE)) == {"backlash_size", "backlash_location"}


def test_the_best_of_each_supposition_comes_first():
    scan, start, noise = scanned({"size": 0.3})
    fits = [scan.fitter.assess(fit, noise) for fit in scan.probes(start, ["size", "curve"], (*SMALL, *LARGE))]
    chosen = best_of_each(fits, 1)
    assert [fit.causes for fit in chosen] == [("size",), ("curve",)] and chosen[0].hope == max(f.hope for f in fits)
