"""Whether axle shafts are bent: a curve that was put in is found, as it is, and none where there is none."""

from types import SimpleNamespace

import numpy as np
import pytest
from floors import measured

from cosim.diagnosis.fit.fitting import Fitter
from cosim.diagnosis.fit.predict import Predictor, coordinates
from cosim.diagnosis.judge.shafts import PLACE, VARIABLE, bent_shafts
from cosim.diagnosis.judge.verdict import MISSING, beside
from cosim.diagnosis.plants.bent import HEIGHTS, KNOTS, BentCar


def asked(car, run, hardening):
    """Of a car whose axle shafts harden with the cube of their twist: whether they are bent."""
    knots = np.linspace(-0.06, 0.06, KNOTS)
    harder = BentCar.like(car)
    curve = {f"input.{name}.offset": hardening * x**3 for name, x in zip(HEIGHTS, knots)}
    raw = harder.raw(harder.values | curve, harder.bent(run.free, knots))
    led = measured(car, run, raw)
    with Predictor(car, [led], coordinates(car, [led])) as predictor:
        fitter = Fitter(predictor)
        file = fitter.nominal()
        noise = fitter.noise(file)
        best = fitter.settle(fitter.assess(fitter.cooled(file, noise), noise), noise)
        return bent_shafts(fitter, SimpleNamespace(best=best, healthy=best, noise=noise), file)


def test_shafts_that_harden_are_bent_by_as_much(car_and_run):
    hardening = 3e6
    bent = asked(*car_and_run, hardening)
    table = bent.disturbance.table
    true = hardening * table[VARIABLE] ** 3
    assert bent.lead > 2.0 * MISSING and bent.disturbance.gain >= bent.lead
    assert np.corrcoef(table["torque"], true)[0, 1] > 0.9
    assert np.ptp(table["torque"]) == pytest.approx(np.ptp(true), rel=0.5)
    left = {"excess": 0.0, "place": "vehicle", "log_evidence": 3.0, "recordings": [3.0]}
    assert beside(left, bent)["place"] == PLACE and beside(left, bent)["log_evidence"] == bent.lead
    assert beside(left | {"log_evidence": bent.lead + 1.0}, bent)["place"] == "vehicle"


def test_straight_shafts_are_not(car_and_run):
    bent = asked(*car_and_run, 0.0)
    assert bent is None or bent.lead < 0.3 * MISSING
    assert beside({"log_evidence": 3.0}, None) == {"log_evidence": 3.0}
