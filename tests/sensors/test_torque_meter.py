"""The torque meter's filter is the thesis's, equals scipy's design, and runs as its response says."""

import numpy as np
import pytest
from scipy import signal

from driveline.quantities import InputError
from driveline.sensors.torque_meter import (
    TorqueMeter,
    filter_order,
    filter_sections,
    frequency_response,
    steady_state,
)

DESIGNS = [TorqueMeter(),
           TorqueMeter(passband_ripple=0.5),
           TorqueMeter(passband_frequency=20.0, stopband_attenuation=60.0),
           TorqueMeter(passband_frequency=5.0, stopband_frequency=100.0, stopband_attenuation=20.0),
           TorqueMeter(sampling_frequency=200.0, passband_frequency=60.0, stopband_frequency=80.0),
           TorqueMeter(passband_frequency=1.0, stopband_frequency=400.0, stopband_attenuation=6.0)]


def scipy_order(meter: TorqueMeter) -> int:
    """The order scipy finds for the meter's bands."""
    return signal.cheb2ord(meter.passband_frequency, meter.stopband_frequency, meter.passband_ripple,
                           meter.stopband_attenuation, fs=meter.sampling_frequency)[0]


def test_the_designs_cover_odd_and_even_orders():
    orders = [filter_order(meter) for meter in DESIGNS]
    assert {order % 2 for order in orders} == {0, 1}
    assert min(orders) == 1


@pytest.mark.parametrize("meter", DESIGNS)
def test_order_and_response_equal_scipys(meter: TorqueMeter):
    assert filter_order(meter) == scipy_order(meter)
    sections = signal.cheby2(scipy_order(meter), meter.stopband_attenuation, meter.stopband_frequency,
                             fs=meter.sampling_frequency, output="sos")
    frequencies = np.linspace(0.0, 0.499 * meter.sampling_frequency, 400)
    expected = signal.sosfreqz(sections, frequencies, fs=meter.sampling_frequency)[1]
    response = frequency_response(filter_sections(meter), frequencies, meter.sampling_frequency)
    np.testing.assert_allclose(response, expected, rtol=0.0, atol=1e-11)


@pytest.mark.parametrize("meter", DESIGNS)
def test_bands_are_kept_and_no_lower_order_would(meter: TorqueMeter):
    def decibel(frequencies):
        response = frequency_response(filter_sections(meter), frequencies, meter.sampling_frequency)
        return 20.0 * np.log10(abs(response))

    passed = decibel(np.linspace(0.0, meter.passband_frequency, 200))
    stopped = decibel(np.linspace(meter.stopband_frequency, 0.499 * meter.sampling_frequency, 2000))
    assert passed.min() >= -meter.passband_ripple - 1e-9
    assert stopped.max() == pytest.approx(-meter.stopband_attenuation, abs=1e-7)  # the stop band's edge
    if filter_order(meter) > 1:
        lower = signal.cheby2(filter_order(meter) - 1, meter.stopband_attenuation, meter.stopband_frequency,
                              fs=meter.sampling_frequency, output="sos")
        edge = signal.sosfreqz(lower, [meter.passband_frequency], fs=meter.sampling_frequency)[1]
        assert 20.0 * np.log10(abs(edge[0])) < -meter.passband_ripple


@pytest.mark.parametrize("meter", DESIGNS)
def test_every_section_is_stable_and_has_unit_gain_at_rest(meter: TorqueMeter):
    for b0, b1, b2, a1, a2 in filter_sections(meter):
        assert abs(np.roots([1.0, a1, a2])).max() < 1.0
        assert b0 + b1 + b2 == pytest.approx(1.0 + a1 + a2, rel=1e-11)


def test_the_thesis_filter_has_order_23_and_the_phase_of_figure_2_7():
    meter = TorqueMeter()
    phase = np.angle(frequency_response(filter_sections(meter), [5.84, 5.88], meter.sampling_frequency))
    assert filter_order(meter) == 23
    assert phase == pytest.approx([-1.280, -1.289], abs=5e-4)
    assert -phase[1] / (2.0 * np.pi * 5.88) == pytest.approx(34.67e-3, rel=0.01)  # eq. 2.3


def run(kernels, sections: np.ndarray, values: np.ndarray, state: np.ndarray, way: str = "native"):
    """The cascade over ``values``, with state and coefficients somewhere inside their arrays."""
    memory = np.concatenate([[np.nan] * 3, state, [np.nan]])
    coefficients = np.concatenate([[np.nan] * 2, sections.ravel()])
    result = np.empty_like(values)
    kernels("filter_signal", way).bind(memory, coefficients, values, result)(3, 2, len(sections), values.size)
    assert np.isnan(memory[[0, 1, 2, -1]]).all()
    return result, memory


@pytest.mark.parametrize("meter", DESIGNS)
def test_running_it_equals_scipys_cascade(kernels, meter: TorqueMeter):
    sections = filter_sections(meter)
    values = np.random.default_rng(3).normal(size=3000)
    result, _ = run(kernels, sections, values, np.zeros(2 * len(sections)))
    scipy_sections = np.insert(sections, 3, 1.0, axis=1)
    np.testing.assert_allclose(result, signal.sosfilt(scipy_sections, values), rtol=0.0, atol=1e-12)


def test_a_sine_comes_out_with_the_gain_and_phase_of_the_response(kernels):
    meter = TorqueMeter()
    sections = filter_sections(meter)
    time = np.arange(10_000) / meter.sampling_frequency
    result, _ = run(kernels, sections, np.sin(2.0 * np.pi * 5.88 * time), np.zeros(2 * len(sections)))
    response = frequency_response(sections, 5.88, meter.sampling_frequency)
    expected = abs(response) * np.sin(2.0 * np.pi * 5.88 * time + np.angle(response))
    np.testing.assert_allclose(result[-2000:], expected[-2000:], rtol=0.0, atol=1e-6)


@pytest.mark.parametrize("meter", DESIGNS)
def test_a_constant_stays_where_the_steady_state_says(kernels, meter: TorqueMeter):
    sections = filter_sections(meter)
    result, _ = run(kernels, sections, np.full(5000, -350.0), steady_state(sections, -350.0))
    np.testing.assert_allclose(result, -350.0, rtol=1e-10)


def test_compiled_and_plain_give_the_same_bits(kernels):
    sections = filter_sections(TorqueMeter())
    values = np.random.default_rng(4).normal(size=1000)
    compiled, plain = (run(kernels, sections, values, steady_state(sections, 2.0), way)
                       for way in ("native", "python"))
    assert compiled[0].tobytes() == plain[0].tobytes()
    assert compiled[1].tobytes() == plain[1].tobytes()


@pytest.mark.parametrize("wrong", [
    {"passband_frequency": 30.0}, {"stopband_frequency": 500.0}, {"sampling_frequency": 50.0},
    {"passband_frequency": 0.0}, {"passband_ripple": 90.0}, {"passband_ripple": 0.0}])
def test_impossible_bands_are_named(wrong: dict[str, float]):
    with pytest.raises(InputError, match=f"torque meter: .*{next(iter(wrong))}"):
        filter_sections(TorqueMeter(**wrong))


@pytest.mark.parametrize("end", [29.9999, 29.9999999999, 30.0 - 4e-15])
def test_bands_so_close_that_a_filter_would_have_thousands_of_sections_are_refused(end):
    with pytest.raises(InputError, match="passband_frequency .* a filter of more than order 200"):
        filter_sections(TorqueMeter(passband_frequency=end))
