"""Closed forms against the dense Gaussian they stand for."""

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.stats import multivariate_normal

from cosim.diagnosis.effect import factor
from cosim.diagnosis.fit.evidence import HETEROGENEITY, Evidence, Layout, Slopes, heterogeneity, prior, within
from cosim.diagnosis.fit.noise import WANDER, WANDER_TIME
from cosim.diagnosis.fit.predict import WANDERS, Coordinate
from cosim.diagnosis.plants.hats import EVERY

RUNS, SAMPLES = 3, 40


def coordinate(name, cause, run, tolerance, spread, low=-np.inf, high=np.inf):
    p = factor(name, name, unit="1", meaning="", spread=spread, limits=(0.1, 10.0), detection=0.4)
    return Coordinate(name, cause, cause, run, p if cause else None, tolerance, spread, 0.1, low, high)


def made(low=-np.inf, high=np.inf):
    """Three causes, one of which swings in the first run alone; evidence of three runs, and what it is made of."""
    random = np.random.default_rng(3)
    coordinates = [coordinate("a", "one", None, 0.1, 1.5, low, high), coordinate("b", "two", None, 0.2, 0.9, low, high),
                   coordinate("c", "two", None, 0.05, 0.7, low, high), coordinate("swing", "three", 0, 0.1, 1.2)]
    coordinates += [coordinate("start", "", r, 0.3, 0.3) for r in range(RUNS)]
    layout = Layout(coordinates, [1] * RUNS)
    jacobians = [random.standard_normal((SAMPLES, len(coordinates))) for _ in range(RUNS)]
    for r, j in enumerate(jacobians):
        j[:, [k for k, c in enumerate(coordinates) if c.run not in (None, r)]] = 0.0
    points = [0.3 * random.standard_normal(len(coordinates)) * (np.abs(j).sum(axis=0) > 0) for j in jacobians]
    targets = [random.standard_normal(SAMPLES) + j[:, 0] - 0.6 * j[:, 1] for j in jacobians]
    # linearised at a point of its own, a run shows the residual there
    seen = [Slopes(layout, r, j[:, layout.columns[r]]).seen(z - j @ p, p)
            for r, (j, z, p) in enumerate(zip(jacobians, targets, points))]
    return coordinates, jacobians, targets, Evidence(seen)


@pytest.fixture(scope="module")
def problem():
    return made()


def covariances(coordinates, jacobians, spread):
    """Of the targets of all runs, with what is every run's own integrated out, not what they share; and of the latter.

    Returns:
        Covariance of the targets, and what coordinates that are shared do to them.
    """
    apart = heterogeneity(coordinates)
    covariance = np.eye(RUNS * SAMPLES)
    for r, j in enumerate(jacobians):
        own = np.where([c.run is not None for c in coordinates], spread**2, 0.0) + apart**2
        place = slice(r * SAMPLES, (r + 1) * SAMPLES)
        covariance[place, place] += j @ np.diag(own) @ j.T
    return covariance, np.vstack(jacobians)[:, [c.run is None for c in coordinates]]


def dense(coordinates, jacobians, targets, spread):
    """Log density of the targets with every unknown integrated out."""
    covariance, shared = covariances(coordinates, jacobians, spread)
    wide = spread[[c.run is None for c in coordinates]]
    return multivariate_normal.logpdf(np.concatenate(targets), cov=covariance + shared @ np.diag(wide**2) @ shared.T)


SUPPOSED = [(), ("one",), ("two",), ("three",), ("one", "two"), ("one", "two", "three")]


@pytest.mark.parametrize("causes", SUPPOSED)
def test_evidence_is_the_dense_gaussian_s(problem, causes):
    coordinates, jacobians, targets, evidence = problem
    spread = prior(coordinates, causes)
    here = evidence.posterior(spread).log_evidence - 0.5 * RUNS * SAMPLES * np.log(2.0 * np.pi)
    assert here == pytest.approx(dense(coordinates, jacobians, targets, spread), abs=1e-6)


def test_what_a_cause_may_be_and_what_runs_may_differ_by():
    coordinates = [coordinate("a", "one", None, 0.1, 1.5), coordinate("swing", "three", 0, 0.1, 1.2),
                   coordinate("file", "", None, 0.04, 0.04), coordinate("start", "", 0, 0.3, 0.3)]
    assert prior(coordinates, ()) == pytest.approx([0.1, 0.1, 0.04, 0.3])
    assert prior(coordinates, ("one",)) == pytest.approx([1.5, 0.1, 0.04, 0.3])
    alone = [HETEROGENEITY * 0.4, 0.0, 0.02, 0.0]  # what is one run's has nothing to differ from
    assert heterogeneity(coordinates) == pytest.approx(alone)
    assert heterogeneity(coordinates, 4) == pytest.approx(2.0 * np.array(alone))


def length(coordinates, jacobians, targets, spread, points):
    """Minus twice the log density, up to a constant, of each run's coordinates (runs x coordinates), those of the
    shared ones first, with these."""
    shared, *own = points
    apart, within_run = heterogeneity(coordinates), np.array([c.run is not None for c in coordinates])
    total = float(np.sum((shared / spread)[~within_run] ** 2))
    for r, (j, z, v) in enumerate(zip(jacobians, targets, own)):
        mine = np.array([c.run == r for c in coordinates])
        total += float(np.sum((z - j @ v) ** 2)) + float(np.sum((v / spread)[mine] ** 2))
        total += float(np.sum(((v - shared)[~within_run] / apart[~within_run]) ** 2))
    return total


def test_the_most_probable_coordinates_of_a_run_are_those_of_the_whole_density(problem):
    coordinates, jacobians, targets, evidence = problem
    spread = prior(coordinates, ("one", "two", "three"))
    posterior = evidence.posterior(spread)
    shared = np.zeros(len(coordinates))
    shared[evidence.layout.shared] = posterior.best
    points = [shared, *(seen.point(posterior.best) for seen in evidence.seen)]
    for r, point in enumerate(points[1:]):
        point[[c.run not in (None, r) for c in coordinates]] = 0.0
    least = length(coordinates, jacobians, targets, spread, points)
    assert posterior.least == pytest.approx(least, abs=1e-8)
    for which in range(1 + RUNS):
        for k, c in enumerate(coordinates):
            # the swing is as its run has it: told apart from nothing
            if c.run is None or (which and c.run == which - 1 and c.name == "start"):
                for step in (-1e-3, 1e-3):
                    moved = [p.copy() for p in points]
                    moved[which][k] += step
                    assert length(coordinates, jacobians, targets, spread, moved) > least, (which, c.name)


def test_bounds_hold_for_what_is_shared_and_for_what_each_run_has():
    low, high = -0.3, 0.4
    coordinates, jacobians, targets, evidence = made(low, high)
    spread = prior(coordinates, ("one", "two"))
    there = evidence.layout.shared
    posterior, free = evidence.posterior(spread), made()[3].posterior(spread)
    assert free.best.max() > high and free.best.min() < low  # both bounds are in the way
    covariance, shared = covariances(coordinates, jacobians, spread)
    wide = spread[[c.run is None for c in coordinates]]

    def least(u):
        missing = np.concatenate(targets) - shared @ u
        return float(missing @ np.linalg.solve(covariance, missing)) + float(np.sum((u / wide) ** 2))

    slow = minimize(least, np.zeros(3), bounds=[(low, high)] * 3, options={"ftol": 1e-15, "gtol": 1e-9})
    assert posterior.best[:3] == pytest.approx(slow.x, abs=1e-4)
    assert posterior.least == pytest.approx(slow.fun, abs=1e-6)
    assert posterior.log_evidence - free.log_evidence == pytest.approx(-0.5 * (posterior.least - free.least))
    of_runs = [seen.point(posterior.best) for seen in evidence.seen]
    assert np.max(of_runs, axis=0)[there].max() == pytest.approx(high)
    assert np.min(of_runs, axis=0)[there].min() == pytest.approx(low)

    apart = heterogeneity(coordinates)[:3]
    for r in (1, 2):  # the first has a swing of its own
        start = jacobians[r][:, 4 + r]
        own = np.eye(SAMPLES) + 0.3**2 * np.outer(start, start)

        def of_the_run(v, r=r, own=own):
            missing = targets[r] - jacobians[r][:, :3] @ v
            further = np.sum(((v - posterior.best[:3]) / apart) ** 2)
            return float(missing @ np.linalg.solve(own, missing)) + float(further)

        slow = minimize(of_the_run, np.zeros(3), bounds=[(low, high)] * 3, options={"ftol": 1e-15, "gtol": 1e-9})
        assert of_runs[r][:3] == pytest.approx(slow.x, abs=1e-4)


def test_posterior_is_where_the_density_is_highest(problem):
    coordinates, _, _, evidence = problem
    spread = prior(coordinates, ("one", "two"))
    posterior = evidence.posterior(spread)
    assert posterior.best[0] == pytest.approx(1.0, abs=0.25)
    assert np.all(np.linalg.eigvalsh(posterior.covariance) > 0.0)
    assert np.sqrt(posterior.covariance[0, 0]) < spread[0]


def test_where_one_of_two_that_make_up_for_each_other_ends_the_other_stays_back():
    factor = np.linalg.cholesky(np.array([[1000.0, 999.0], [999.0, 1000.0]]))
    low, high = np.array([0.0, -10.0]), np.full(2, 10.0)
    inside = np.array([3.0, -3.0])
    assert within(factor, inside, low, high) is inside
    assert within(factor, -inside, low, high) == pytest.approx([0.0, 0.003], abs=1e-9)  # the nearest is [0, 3]


@pytest.mark.parametrize("seed", range(10))
def test_the_most_probable_point_within_bounds_is_the_one_a_minimiser_finds(seed):
    random = np.random.default_rng(seed)
    matrix = random.standard_normal((6, 4))
    precision, best = matrix.T @ matrix, 2.0 * random.standard_normal(4)
    found = within(np.linalg.cholesky(precision), best, -np.ones(4), np.ones(4))
    slow = minimize(lambda x: (x - best) @ precision @ (x - best), np.zeros(4), bounds=[(-1.0, 1.0)] * 4,
                    options={"ftol": 1e-14, "gtol": 1e-10})
    assert found == pytest.approx(slow.x, abs=1e-5)


def test_however_sharp_a_run_says_no_more_than_heterogeneity_allows(problem):
    coordinates, jacobians, targets, _ = problem
    layout = Layout(coordinates, [1] * RUNS)
    seen = [Slopes(layout, r, 1e3 * j[:, layout.columns[r]]).seen(1e3 * z, np.zeros(len(coordinates)))
            for r, (j, z) in enumerate(zip(jacobians, targets))]
    deviations = np.sqrt(np.diag(Evidence(seen).posterior(prior(coordinates, ("one", "two"))).covariance))
    assert np.all(deviations[:3] > 0.95 * layout.deviations[0][:3] / np.sqrt(RUNS))
    assert deviations[3] < 1e-2 * layout.deviations[0][:3].min()  # a swing of one run has nothing to differ from


def test_what_a_manoeuvre_says_that_is_repeated_is_what_runs_say_that_err_alike():
    """To the dense Gaussian, where each repeat shows the same: three runs have one d, and a fourth has its own."""
    random = np.random.default_rng(4)
    coordinates = [coordinate("a", "one", None, 0.1, 1.5), coordinate("b", "two", None, 0.2, 0.9)]
    coordinates += [coordinate("start", "", r, 0.3, 0.3) for r in range(4)]
    layout, apart = Layout(coordinates, [3, 3, 3, 1]), heterogeneity(coordinates)[:2]
    repeated, other, start = (random.standard_normal((SAMPLES, n)) for n in (2, 2, 1))
    shared = [repeated, repeated, repeated, other]
    targets = random.standard_normal((4, SAMPLES)) + 0.2 * repeated[:, 0]
    evidence = Evidence([Slopes(layout, r, np.column_stack([slopes, start])).seen(z, np.zeros(6))
                         for r, (slopes, z) in enumerate(zip(shared, targets))])

    def dense(spread):
        err = [[np.diag(spread[:2] ** 2 + (r == s or max(r, s) < 3) * apart**2) for s in range(4)] for r in range(4)]
        covariance = np.block([[shared[r] @ err[r][s] @ shared[s].T for s in range(4)] for r in range(4)])
        covariance += np.eye(4 * SAMPLES) + np.kron(np.eye(4), 0.3**2 * start @ start.T)
        return multivariate_normal.logpdf(targets.ravel(), cov=covariance)

    healthy = prior(coordinates, ())
    for causes in (("one",), ("two",), ("one", "two")):
        spread = prior(coordinates, causes)
        here = evidence.posterior(spread).log_evidence - evidence.posterior(healthy).log_evidence
        assert here == pytest.approx(dense(spread) - dense(healthy), abs=1e-6)


def test_causes_that_do_almost_the_same_are_almost_equally_evident_however_sharp_they_are():
    """Their derivatives come in single precision; their squares in single would be negative between the two."""
    random = np.random.default_rng(5)
    coordinates = [coordinate(name, name, None, 0.08, 1.0) for name in ("a", "b", "c")]
    coordinates.append(coordinate("start", "", 0, 0.3, 0.3))
    one, other, apart = 100.0 * random.standard_normal((3, 9000)).astype(np.float32)
    slopes = Slopes(Layout(coordinates, [1]), 0, np.column_stack([one, one + 1e-3 * apart, other, apart]))
    assert np.linalg.eigvalsh(slopes.capped).min() >= 0.0
    evidence = Evidence([slopes.seen(0.4 * one.astype(float) + random.standard_normal(9000), np.zeros(4))])
    first, second, third = (evidence.posterior(prior(coordinates, [name])).log_evidence for name in "abc")
    assert first == pytest.approx(second, abs=0.01) and first > third + 2.0


def test_what_a_wide_coordinate_can_do_is_not_apart(problem):
    coordinates, _, _, evidence = problem
    change = np.zeros(len(coordinates))
    change[0] = 0.5
    near = evidence.separation(change, prior(coordinates, ("one",)))
    far = evidence.separation(change, prior(coordinates, ("two",)))
    assert near < 0.5 < 1.5 < far


def test_a_wandering_torque_is_alike_from_hat_to_hat():
    coordinates = [coordinate("a", "one", None, 0.1, 1.5)] + [
        Coordinate(WANDERS, "", "", 0, None, WANDER, WANDER, 1.0, part=k) for k in range(6)]
    covariance = np.linalg.inv(Layout(coordinates, [1]).precision[0])
    assert np.sqrt(covariance[2, 2]) == pytest.approx(WANDER)
    assert covariance[2, 3] / covariance[2, 2] == pytest.approx(np.exp(-EVERY / WANDER_TIME), rel=1e-6)


def test_occam_is_half_the_logarithm_of_the_share_of_the_prior_that_data_leave(problem):
    coordinates, _, _, evidence = problem
    spread = prior(coordinates, ("one", "three"))
    posterior = evidence.posterior(spread)
    left = np.linalg.slogdet(posterior.covariance)[1] - 2.0 * np.sum(np.log(spread[evidence.layout.shared]))
    assert evidence.occam(spread) == pytest.approx(-0.5 * left, rel=1e-9)


def test_a_change_is_as_far_as_chi_square_says_where_what_imitates_it_is_integrated_out(problem):
    coordinates, jacobians, _, evidence = problem
    change, spread = np.zeros(len(coordinates)), prior(coordinates, ("two",))
    change[:3] = 0.5, -0.1, 0.2
    covariance, shared = covariances(coordinates, jacobians, prior(coordinates, ()))
    covariance = covariance + shared @ np.diag(spread[:3] ** 2) @ shared.T
    seen = np.vstack(jacobians) @ change
    assert evidence.separation(change, spread) == pytest.approx(
        float(np.sqrt(seen @ np.linalg.solve(covariance, seen))))
    nearest = evidence.imitated(change, spread)
    assert np.all(nearest[[c.nuisance for c in coordinates]] == 0.0)
    as_far = change - nearest
    # what is left of it by its own size is what is left of it by chi square
    wide = spread[:4]
    square = evidence.separation(as_far, np.full(len(coordinates), 1e-9)) ** 2 + np.sum((nearest[:4] / wide) ** 2)
    assert square == pytest.approx(evidence.separation(change, spread) ** 2, rel=1e-6)


def test_what_a_run_is_expected_to_say_is_what_it_says_when_it_shows_that(problem):
    coordinates, jacobians, _, evidence = problem
    layout = evidence.layout
    there = np.zeros(len(coordinates))
    there[:3] = 0.7, -0.2, 0.1
    slopes = Slopes(layout, 0, 2.0 * jacobians[0][:, layout.columns[0]])
    driven = Evidence([*evidence.seen, slopes.seen(np.zeros(SAMPLES), there)])
    expected = evidence.expecting(slopes.capped, there[layout.shared])
    spreads = [prior(coordinates, causes) for causes in ((), ("one",), ("two",))]
    leads = [[e.posterior(s).log_evidence - e.posterior(spreads[0]).log_evidence for s in spreads]
             for e in (driven, expected)]
    assert leads[1] == pytest.approx(leads[0], abs=1e-8) and max(leads[0]) > 1.0
    assert expected.posterior(spreads[1]).best == pytest.approx(driven.posterior(spreads[1]).best, abs=1e-9)


def test_what_all_say_is_what_two_say_and_then_the_third_given_these(problem):
    coordinates, jacobians, targets, evidence = problem
    others = Evidence([evidence.seen[0], evidence.seen[2]])
    left = [dense(coordinates, jacobians, targets, spread) - others.posterior(spread).log_evidence
            - evidence.foretold(spread)[1] for spread in (prior(coordinates, causes) for causes in ((), ("one",)))]
    assert left[1] == pytest.approx(left[0], abs=1e-6)  # up to what all suppositions share
