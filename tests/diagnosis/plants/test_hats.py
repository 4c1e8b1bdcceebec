"""Rows of hats: what is unknown over time."""


import numpy as np

from cosim.diagnosis.plants.hats import EVERY, MEMORY, comb, fast, hats, row, teeth


def test_hats_apart_make_up_every_hat(car_and_run):
    _, run = car_and_run
    whole = sum(row(run, comb(hats(run).size, k, MEMORY)) for k in range(teeth(MEMORY)))
    inside = (run.time - 1e-3 > hats(run)[0]) & (run.time - 1e-3 < hats(run)[-1])
    assert np.allclose(whole[inside], 1.0)


def test_hats_follow_what_is_slow_and_leave_what_is_fast(car_and_run):
    _, run = car_and_run
    inside = (run.time > hats(run)[1]) & (run.time < hats(run)[-2])
    for period, left in ((20.0 * EVERY, 0.03), (EVERY, 0.6)):
        torque = np.sin(2.0 * np.pi * run.time / period)
        rest = np.std(fast(run, torque)[inside]) / np.std(torque[inside])
        assert rest < left if period > 5.0 * EVERY else rest > left
