"""Which suppositions count, and what a run counts for that none explains."""

from dataclasses import replace

import numpy as np
import pytest
from vibration import CLOCK, DETECTION, RUNS, Plant, WithStages, found

from cosim.diagnosis.search.identify import Search


def test_what_would_have_to_be_implausible_is_no_cause():
    """It explains most of what is wrong, and more than anything else does, where it may be no larger."""
    search, result = found({"curve": 1.3})
    assert ("curve",) not in [fit.causes for fit in result.alternatives]
    fit = search.pool.fits[("curve",)]
    assert fit.score > result.healthy.score + 20.0 and fit.score > result.best.score
    assert fit.shared[4] == pytest.approx(1.0, abs=0.2 * DETECTION) and not search.pool.worth(fit)
    assert search.pool.worth(replace(fit, near=False))  # on its way, it may come back


def test_a_wide_stage_that_is_hardly_another_is_no_cause():
    """Neither number of a cause like that does anything alone, so it is as large as the smaller of the two."""
    search = Search(WithStages({}, stage=0.5 * DETECTION, width=0.5), lambda text: None)
    result = search.run()
    fit = search.pool.fits[("stages",)]
    assert fit.score > result.healthy.score and fit.shared[4] > 3.0 * DETECTION
    assert search.pool.size(fit, "stages") == pytest.approx(abs(fit.shared[3]) / DETECTION)
    assert not search.pool.worth(fit) and "stages" not in result.best.causes


def test_a_run_that_nothing_explains_counts_for_less():
    plant = Plant({"size": 0.3})
    plant.runs[1].measured["engine_speed"][:] += 0.5 * np.sign(np.sin(2.0 * np.pi * 3.7 * CLOCK))
    search = Search(plant, lambda text: None)
    result = search.run()
    plain = search.fitter.noise(result.best)
    scales = [np.median(result.noise.scales[r] / plain.scales[r]) for r in range(RUNS)]
    assert scales[0] == pytest.approx(1.0, abs=0.2) and scales[1] > 1.5
    assert result.best.causes == ("size",)
