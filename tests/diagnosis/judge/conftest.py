"""What is judged here is a matter of hundreds of simulations: of the begin of a tip-in."""

import pytest
from floors import shortened


@pytest.fixture(scope="module")
def car_and_run(car_and_run):
    """A car, and the first 3 s of its tip-in."""
    car, run = car_and_run
    return car, shortened(run, 3.0)
