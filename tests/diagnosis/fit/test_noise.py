import numpy as np
import pytest

from cosim.diagnosis.fit.noise import WANDER, WANDER_TIME, Noise, _correlation_time, bends, floor, wander
from cosim.diagnosis.plants import Run

CLOCK = np.arange(0.0, 6.0, 0.01)


def run(name, values):
    return Run(name, "tip_in", 5, 0.0, np.zeros((6000, 1)), 10.0, {"engine_speed": CLOCK}, {"engine_speed": values})


@pytest.fixture
def white():
    return 0.05 * np.random.default_rng(1).standard_normal(CLOCK.size)


def test_the_floor_is_the_noise_and_not_the_motion(white):
    assert floor(white + 100.0 + 5.0 * np.sin(2.0 * np.pi * 2.0 * CLOCK)) == pytest.approx(0.05, rel=0.15)


def test_a_resolution_is_a_floor():
    step = 0.2
    assert floor(np.round(np.sin(CLOCK) / step) * step) == pytest.approx(step / np.sqrt(12.0), rel=1e-6)


def test_samples_that_are_alike_count_less():
    random, keep = np.random.default_rng(2), 0.9
    values = np.zeros(40000)
    for i in range(1, values.size):
        values[i] = keep * values[i - 1] + random.standard_normal()
    assert _correlation_time([values]) == pytest.approx((1.0 + keep) / (1.0 - keep), rel=0.2)
    assert _correlation_time([random.standard_normal(5000)]) == pytest.approx(1.0, abs=0.1)


def test_the_wandering_torque_has_its_size_and_time():
    values = wander(2_000_000, 1e-3, np.random.default_rng(5))
    assert np.std(values) == pytest.approx(WANDER, rel=0.03)
    lag = round(WANDER_TIME / 1e-3)
    assert np.mean(values[:-lag] * values[lag:]) == pytest.approx(WANDER**2 / np.e, rel=0.1)


def still(draws=4):
    return [np.zeros((draws, CLOCK.size))], [np.zeros(CLOCK.size)]


def test_white_residuals_of_the_floor_s_size_are_whitened_to_one(white):
    noise = Noise([run("a", white)], *still())
    assert np.std(noise.whiten(0, white)) == pytest.approx(1.0, abs=0.15)
    assert noise.excess([white])[0]["engine_speed"] < 0.1


def test_what_strays_slowly_counts_as_few_samples(white):
    random, keep = np.random.default_rng(2), 0.9
    strays = np.zeros((6, CLOCK.size))
    for i in range(1, CLOCK.size):
        strays[:, i] = keep * strays[:, i - 1] + random.standard_normal(6)
    noise = Noise([run("a", white)], [strays], [np.zeros(CLOCK.size)])
    size = 1.0 / np.sqrt(1.0 - keep**2)
    assert np.median(noise.least[0]) == pytest.approx(size, rel=0.25)
    assert np.median(noise.scales[0] / noise.least[0]) ** 2 == pytest.approx((1.0 + keep) / (1.0 - keep), rel=0.4)


def test_what_a_model_leaves_is_no_noise_but_an_excess(white):
    noise = Noise([run("a", white)], *still())
    assert noise.excess([10.0 * white])[0]["engine_speed"] == pytest.approx(np.log(10.0), abs=0.15)
    assert np.array_equal(noise.scales[0], Noise([run("a", white)], *still()).scales[0])


def test_a_few_seconds_that_do_not_fit_cost_their_logarithm_not_their_square(white):
    worse = white.copy()
    worse[300:330] += 1.0
    noise = Noise([run("a", white)], *still())
    heavy, [cost] = noise.heavy([worse])
    plain = 0.5 * np.sum(noise.whiten(0, worse) ** 2)
    tailed = 0.5 * np.sum(heavy.whiten(0, worse) ** 2) + cost
    assert tailed < 0.5 * plain
    assert noise.heavy([white])[1].tolist() == [0.0]


@pytest.mark.parametrize("power", [1.0, 2.0])
def test_what_is_missed_by_more_never_costs_less(white, power):
    """It did with power 2, from twice to four times the usual errors: healthy cars were passed by what fitted worse."""
    noise, costs = Noise([run("a", white)], *still()), []
    missed = (CLOCK > 2.0) & (CLOCK < 3.0)
    sizes = 0.05 * np.geomspace(0.5, 50.0, 30)
    for size in sizes:
        residual = white + size * missed * np.sign(white)
        heavy, [cost] = noise.heavy([residual], power)
        costs.append(0.5 * np.sum(heavy.whiten(0, residual) ** 2) + cost)
    assert np.all(np.diff(costs) > 0.0)
    assert costs[-1] - costs[-10] == pytest.approx(np.log(sizes[-1] / sizes[-10]) * missed.sum(), rel=0.4)


def test_a_run_at_a_temperature_says_less_and_is_no_noisier(white):
    noise = Noise([run("a", white)], *still())
    warm = noise.tempered([4.0])
    assert np.sum(warm.whiten(0, white) ** 2) == pytest.approx(0.25 * np.sum(noise.whiten(0, white) ** 2))
    assert warm.excess([10.0 * white]) == noise.excess([10.0 * white])
    assert warm.undoubted.scales[0] == pytest.approx(noise.scales[0]) and warm.undoubted.temperatures == [1.0]
    assert np.array_equal(noise.scales[0], Noise([run("a", white)], *still()).scales[0])


def test_what_jumps_bends_and_what_swings_does_not():
    clock = np.arange(0.0, 1.0, 1e-3)
    swings, jumps = np.sin(2.0 * np.pi * 5.0 * clock), np.where(clock < 0.5, 0.0, 3.0)
    assert np.max(bends(swings)) == pytest.approx((2.0 * np.pi * 5e-3) ** 2, rel=0.01)
    assert np.max(bends(jumps)) == pytest.approx(3.0)
    assert np.flatnonzero(bends(jumps)).tolist() == list(range(495, 505))


def test_a_sample_beside_a_jump_says_little_and_the_others_what_they_did(white):
    bent = np.zeros(CLOCK.size)
    bent[200] = 5.0
    noise, plain = (Noise([run("a", white)], still()[0], [b]) for b in (bent, np.zeros(CLOCK.size)))
    missed = np.zeros(CLOCK.size)
    missed[200] = 5.0  # the jump came after it
    assert np.sum(noise.whiten(0, missed) ** 2) == pytest.approx(1.0, abs=0.01)
    assert np.array_equal(np.delete(noise.scales[0], 200), np.delete(plain.scales[0], 200))
