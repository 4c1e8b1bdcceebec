"""The boundary of a model: variables by name, what is refused, and state that is complete."""

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from driveline.kernels.layout import TIME_TOLERANCE
from driveline.model import LATEST, Model
from driveline.models import MODELS
from driveline.quantities import InputError, Variable
from driveline.vehicles import load


class Integrator(Model):
    """y' = gain u, in one Euler step; its state grows with a parameter."""

    name = "integrator"
    variables = (
        Variable("u", "m/s", "input", causality="input", variability="continuous", minimum=-10.0,
                 maximum=10.0),
        Variable("y", "m", "output", causality="output", variability="continuous"),
        Variable("gain", "1", "gain", start=2.0, minimum=0.0, variability="tunable"),
        Variable("size", "1", "entries of the state", start=1.0, minimum=1.0, kind="integer"),
    )

    def _prepare(self):
        self.state = np.zeros(int(self["size"]))

    def _initialize(self, start_time):
        self.state[:] = start_time
        self.values[1] = self.state[0]

    def _step(self, time, dt):
        self.state += self["gain"] * self["u"] * dt
        self.values[1] = self.state[0]


def started(**values):
    model = Integrator()
    for name, value in values.items():
        model[name] = value
    model.initialize()
    return model


def test_values_are_read_and_written_by_name_and_start_at_their_start():
    model = Integrator()
    assert [model[v.name] for v in model.variables] == [0.0, 0.0, 2.0, 1.0]
    model["u"] = 3.0
    assert model.values[model.index["u"]] == 3.0 == model["u"]
    with pytest.raises(KeyError, match="speed"):
        model["speed"] = 1.0


@pytest.mark.parametrize("name, value, said", [
    ("u", np.nan, "u is nan: a finite number in m/s"), ("u", 11.0, "at most 10"),
    ("gain", -1.0, "at least 0"), ("size", 1.5, "whole number")])
def test_what_is_not_possible_is_refused_where_it_is_set_and_where_it_is_used(name, value, said):
    model = started()
    with pytest.raises(InputError, match=said):
        model[name] = value
    assert model[name] == Integrator()[name]
    if name == "size":
        return
    model.values[model.index[name]] = value  # as a host writes it
    with pytest.raises(InputError, match=said):
        model.initialize()


def test_a_step_checks_its_length_and_its_inputs_and_moves_nothing_when_it_refuses():
    model = started(u=1.0)
    before = model.save()
    for dt in (0.0, -0.1, np.nan, np.inf):
        with pytest.raises(InputError, match="communication step"):
            model.step(0.0, dt)
    assert model.save() == before
    model.values[0] = np.inf
    with pytest.raises(InputError, match="u is inf"):
        model.step(0.0, 0.1)
    assert model.state[0] == 0.0


@given(st.lists(st.floats(-10.0, 10.0), min_size=1, max_size=6), st.integers(1, 5))
def test_saved_and_restored_it_goes_on_to_the_bit(inputs, size):
    model = started(size=size)
    for u in inputs:
        model["u"] = u
        model.step(0.0, 0.1)
    saved = model.save()
    fresh = Integrator()
    fresh.restore(saved)
    assert fresh.save() == saved
    for other in (model, fresh):
        other["u"] = 1.0
        other.step(0.0, 0.3)
    assert fresh.save() == model.save()


def test_restoring_also_brings_back_parameters_and_the_size_of_the_state():
    big, small = started(size=3, u=1.0), started()
    big.step(0.0, 1.0)
    small.restore(big.save())
    assert small["size"] == 3.0
    assert (small.state == big.state).all()
    small.step(0.0, 1.0)
    assert small["y"] == 4.0


def test_what_was_saved_before_initialising_restores_to_that():
    saved = Integrator().save()
    model = started(size=2, u=1.0)
    model.restore(saved)
    assert model.state.size == 0
    assert model["size"] == 1.0
    model.initialize()
    assert model.state.size == 1


@pytest.mark.parametrize("damage", [
    lambda saved: b"", lambda saved: saved[:-1], lambda saved: saved[:-8], lambda saved: saved + bytes(8),
    lambda saved: struct.pack("<q", 7) + saved[8:], lambda saved: b"hello"])
def test_bytes_of_something_else_are_refused_and_nothing_changes(damage):
    model = started(u=2.0, size=2)
    model.step(0.0, 1.0)
    other = started(u=1.0, size=2)
    before = other.save()
    with pytest.raises(InputError, match="not a saved state of integrator"):
        other.restore(damage(model.save()))
    assert other.save() == before


def test_a_later_start_time_reaches_the_model():
    model = Integrator()
    model.initialize(5.0)
    assert model["y"] == 5.0


def test_instants_that_are_possible_are_told_apart_as_finely_as_the_kernels_ask():
    """An instant that is computed in two ways, each by two roundings, is one."""
    assert 2.0 * np.spacing(np.nextafter(LATEST, 0.0)) <= TIME_TOLERANCE < 4.0 * np.spacing(LATEST)


@pytest.mark.parametrize("time", [1.001 * LATEST, -1.001 * LATEST, 8.9e6, np.nan, np.inf])
def test_a_time_beyond_which_clocks_are_not_exact_is_refused_and_nothing_moves(time):
    with pytest.raises(InputError, match="the start is .* at most 4194304 s is needed"):
        Integrator().initialize(time)
    model = started(u=1.0)
    before = model.save()
    with pytest.raises(InputError, match="the time is .* at most 4194304 s is needed"):
        model.step(time, 0.1)
    assert model.save() == before


@pytest.mark.parametrize("name", sorted(MODELS))
def test_every_model_declares_what_a_host_shows(name):
    model = MODELS[name]
    assert model.name == name
    assert model.description and model.default_step > 0.0


@pytest.mark.parametrize("name", [name for name in MODELS if name != "plant_fom"])
def test_what_gears_and_final_drives_turn_by_is_within_what_there_is(name):
    """With a final drive of a million the lash observer's outputs were NaN."""
    start = MODELS[name].defaults_from(load("pickup_10r80"), 5)
    for ratio in ("gear.transmission_ratio", "gear.final_drive_ratio"):
        with pytest.raises(InputError, match=ratio):
            MODELS[name](start | {ratio: 1e6}).initialize()
