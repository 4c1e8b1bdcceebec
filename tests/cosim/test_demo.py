"""The example measurement is what it says it is, and the demo finds the difference that is in it."""

import tomllib

import numpy as np
import pytest

from cosim import demo
from cosim.master import Scenario
from cosim.measured import load


def test_the_example_says_that_it_is_generated():
    text = (demo.FOLDER / "measurement.toml").read_text()
    assert text.startswith("# Generated, not measured")
    assert set(tomllib.loads(text)["channels"]) == {"time", *demo.LOGGED}


def test_the_example_is_read_without_repairs_on_irregular_clocks():
    manoeuvre = load(demo.FOLDER).manoeuvres[0]
    assert manoeuvre.notices == ()
    assert (manoeuvre.kind, manoeuvre.gear) == ("tip_in", 5)
    for name, (_, _, period, jitter, _, _) in demo.LOGGED.items():
        distance = np.diff(manoeuvre[name].time)
        assert distance.mean() == pytest.approx(period, rel=1e-2)
        assert distance.std() >= 0.5 * jitter


def test_the_generator_gives_the_same_example_again(tmp_path):
    demo.generate(tmp_path / "one")
    demo.generate(tmp_path / "two")
    for name in ("measurement.toml", "tip_in_5th.csv"):
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()


def test_the_plant_as_generated_meets_the_example_within_its_noise(tmp_path):
    """With the two differences put in, what is left is noise and clocks; without them it is not."""
    demo.generate(tmp_path)
    nominal = {name: factor * Scenario.load("demo", twins=True).master().variable(f"plant.{name}").start
               for name, factor in demo.CHANGED.items()}
    without = Scenario.load("demo", measurement=tmp_path, twins=True)
    changed = Scenario.load("demo", {f"plant.{n}": v for n, v in nominal.items()}, tmp_path, twins=True)
    before, after = ({c.channel: c for c in s.compare(s.run())} for s in (without, changed))
    for name in ("vehicle_speed", "propeller_shaft_torque", "seat_acceleration"):
        factor = 1 / 3.6 if name == "vehicle_speed" else 1.0
        noise = factor * demo.LOGGED[name][4]
        assert before[name].rms_error > 3.0 * noise
        assert after[name].rms_error == pytest.approx(noise, rel=0.35)
