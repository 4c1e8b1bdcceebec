"""Findings and results of blind cases, put together by hand: right, wrong and modest ones."""

from benchmarks.blind.reading import NOTHING
from cosim.diagnosis.catalogue import CATALOGUE
from cosim.diagnosis.hidden.outside import OUTSIDE

SINGLE = [{"engine_inertia": {"engine_inertia": 1.2}}, {"shaft_stiffness": {"axle_shaft_stiffness": 0.75}},
          {"torque_meter_offset": {"torque_meter_offset": -8.0}}, {"wheel_speed_delay": {"wheel_speed_delay": 0.02}},
          {"mesh_loss": {"transmission_loss": 1.6}}]
NOMINAL = {"engine.inertia": 0.31, "axle_shaft.stiffness": 1.1e4, "propeller_shaft.stiffness": 1.2e4,
           "observe.propeller_shaft_torque.offset": 2.5}


def cause(effect, sizes, probability=1.0, off=0.0, width=0.1):
    """As a finding has it, its sizes off by a share of them."""
    parameters = {}
    for p in CATALOGUE[effect].parameters:
        size = sizes.get(p.name, p.neutral)
        nominal = p.physical(p.neutral, NOMINAL)[0]
        value, low, high = (p.physical(size * (1.0 + off + d), NOMINAL)[1] for d in (0.0, -width, width))
        parameters[p.name] = {"nominal": nominal, "value": value, "low90": min(low, high), "high90": max(low, high)}
    return {"effect": effect, "probability": probability, "parameters": parameters}


def finding(verdict, causes=(), ambiguous=(), unknown=None, gain=None):
    instead = {effect for effects in ambiguous for effect in effects}
    return {"verdict": verdict, "causes": list(causes), "unknown": unknown, "gain": gain,
            "together": [c["effect"] for c in causes if c["effect"] not in instead],
            "ambiguous_with": [{"effects": list(effects)} for effects in ambiguous]}


def result(category, found, effects=None, outside=None, **more):
    truth = {"effects": effects or {}, "changed": {}, "structure": "same", "outside": {
        name: {"size": 1.0, "unit": "1", "balance": OUTSIDE[name].balance,
               "driving_variables": list(OUTSIDE[name].driving_variables)} for name in outside or ()}}
    return {"name": f"{category}-0", "category": category, "effects": [*(effects or {})], "seed": 0,
            "structure": "same", "manoeuvres": None, "vehicle": "pickup_10r80", "truth": truth, "finding": found,
            "error": None, "seconds": 1.0, "gain": None, "shuffle": None, "again": None} | more


def perfect():
    results = [result("single", finding("cause", [cause(e, s) for e, s in truth.items()]), truth) for truth in SINGLE]
    for a, b in zip(SINGLE, SINGLE[1:]):
        found = finding("cause", [cause(e, s, 0.5) for e, s in (b | a).items()])
        results.append(result("pair", found, a | b))
    results += [result(name, finding("none")) for name in NOTHING]
    results += [result("outside", finding("unknown", unknown={
        "balance": about.balance, "driving_variable": about.driving_variables[0]}), outside=[name])
        for name, about in OUTSIDE.items()]
    return results
