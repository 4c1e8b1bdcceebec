"""Where a fit of one supposition ends."""

import numpy as np
import pytest

from cosim.diagnosis.fitting import Fitter
from cosim.diagnosis.hidden import hide
from cosim.diagnosis.plants import FullOrderCar
from cosim.diagnosis.predict import Predictor, coordinates
from cosim.measured import load


@pytest.fixture(scope="module")
def pulses(tmp_path_factory):
    """A pulse train, which crosses the lash six times, of a healthy car, and what its file has wrong."""
    folder = tmp_path_factory.mktemp("fitting") / "m"
    hidden = hide([], 3, folder, structure="same", manoeuvres=["pulse_train:4"])
    measurement = load(folder)
    car = FullOrderCar(measurement.vehicle, measurement.variant)
    return car, car.runs(measurement), hidden


def true_coordinates(listed, hidden):
    """Of every number of the file and every run; no effect is there."""
    point = np.zeros(len(listed))
    for i, c in enumerate(listed):
        if c.run is None and not c.effect:
            table = c.name.partition("[")[0]
            point[i] = np.log1p(next((x for name, x in hidden.drift.items() if name.partition("[")[0] == table), 0.0))
        elif c.name in ("torque", "grade"):
            point[i] = hidden.recordings[c.run]["torque_bias" if c.name == "torque" else c.name]
    return point


def test_from_the_vehicle_file_it_is_as_good_a_fit_as_from_the_truth(pulses):
    """Steps by derivatives of where nothing fits ended 950 below, with a lash shifted by nine times its tolerance."""
    car, runs, hidden = pulses
    with Predictor(car, runs, coordinates(car, runs)) as predictor:
        fitter = Fitter(predictor)
        file = fitter.nominal()
        noise = fitter.noise(file)
        start = fitter.at(true_coordinates(predictor.coordinates, hidden))
        fits = [fitter.settle(fitter.assess(begun, noise), noise)
                for begun in (fitter.cooled(file, noise), fitter.refine(start, noise))]
    assert fits[0].score > fits[1].score - 10.0
    apart = fits[0].shared[fitter.layout.shared] / fitter.scale[fitter.layout.shared]
    assert np.abs(apart).max() < 3.0
