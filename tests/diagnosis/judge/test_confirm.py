"""Causes judged on stretches of a drive that were left out."""

from dataclasses import replace

import numpy as np
import pytest
from drives import FLOORS, MASS, SLIP, driven

from cosim.diagnosis.fit.fitting import Fit
from cosim.diagnosis.fit.predict import Predictor, coordinates
from cosim.diagnosis.judge.confirm import FEWEST, Jury, words
from cosim.diagnosis.plants import FullOrderCar
from cosim.diagnosis.search.identification import Identification

SIZES = {SLIP: 2.0, MASS: np.log(0.8)}


@pytest.fixture(scope="module")
def car():
    return FullOrderCar("pickup_10r80", "modified")


def supposed(declared, causes, score):
    shared = np.array([SIZES.get(c.cause, 0.0) if c.cause in causes else 0.0 for c in declared])
    return Fit(causes, shared, [shared], [], [], score=score)


@pytest.mark.parametrize(("hidden", "known"), [((SLIP,), True), ((SLIP,), False), ((SLIP, MASS), True)])
def test_what_only_the_fitted_stretches_show_is_no_cause(car, hidden, known):
    """The best by their evidence has one cause too many, or none; the others were not asked.

    What is confirmed of it is found also where nobody had fitted that alone.
    """
    random = np.random.default_rng(2)
    declared = coordinates(car, [driven(car, random, 0, hidden)])
    further = [driven(car, random, number, hidden) for number in range(1, FEWEST + 1)]
    predictor = Predictor(car, [driven(car, random, 0, hidden)], declared)
    fits = [supposed(declared, causes, score) for causes, score in (
        ((SLIP, MASS), -100.0), ((SLIP,), -104.0), ((), -108.0)) if known or causes != (SLIP,)]
    asked = []

    def fitted(causes):
        asked.append(causes)
        return supposed(declared, causes, -104.0)

    found = Identification(fits[0], fits, fits[-1], None, [], [], {})
    judged, verdicts = Jury(predictor, further, FLOORS).judged(found, fitted)
    assert judged.best.causes == hidden and asked == [(SLIP,)] * (not known)
    assert {verdict.cause: verdict.confirmed for verdict in verdicts} == {SLIP: True, MASS: MASS in hidden}
    assert all(fit.causes in ((), (SLIP,), hidden) for fit in judged.alternatives)
    slip, mass = words(verdicts, len(further))
    assert slip.startswith(f"{FEWEST} further stretches confirm converter slip, slip target: the error there is ")
    assert ("do not confirm vehicle mass" in mass) == (MASS not in hidden)


def test_where_nothing_is_confirmed_nothing_is_found(car):
    random = np.random.default_rng(3)
    run = driven(car, random, 0)
    declared = coordinates(car, [run])
    fits = [supposed(declared, causes, score) for causes, score in (((SLIP,), -100.0), ((), -120.0))]
    further = [driven(car, random, number) for number in range(1, FEWEST + 1)]
    judged, [verdict] = Jury(Predictor(car, [run], declared), further, FLOORS).judged(
        Identification(fits[0], fits, fits[-1], None, [], [], {}), lambda causes: pytest.fail("none of these"))
    assert judged.best.causes == () and not verdict.confirmed and verdict.share > 1.0


def test_the_same_causes_in_another_size_are_judged_anew(car):
    """As large as they are beside others that imitate them, and as large as they are alone."""
    random = np.random.default_rng(4)
    run, *further = (driven(car, random, number, (SLIP,)) for number in range(3))
    declared = coordinates(car, [run])
    right = supposed(declared, (SLIP,), 0.0)
    small = replace(right, shared=0.2 * right.shared)
    jury = Jury(Predictor(car, [run], declared), further, FLOORS)
    assert np.all(jury._errors(small) > 1.2 * jury._errors(right))
