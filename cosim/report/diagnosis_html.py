"""The report of a diagnosis: one self-contained page that is understood in a minute."""

from __future__ import annotations

import html
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from cosim.diagnosis.diagnose import Diagnosis

_WIDTH, _HEIGHT = 560, 150
_POINTS = 500
_COLOURS = {"measured": "#222222", "before": "#d2691e", "after": "#1f77b4"}
_TITLES = {"cause": "The cause is named", "ambiguous": "Several causes are possible",
           "unknown": "Something is wrong that the catalogue does not know", "none": "Nothing is significantly wrong"}
_STYLE = """
:root { color-scheme: light; font-family: system-ui, sans-serif; color: #222; line-height: 1.4; }
body { max-width: 1180px; margin: 0 auto; padding: 1.2rem; background: #fafafa; }
h1 { font-size: 1.5rem; margin: 0 0 .2rem; } h2 { font-size: 1.1rem; margin: 1.6rem 0 .5rem; }
.verdict { border-left: 6px solid #1f77b4; background: #fff; padding: .8rem 1rem; border-radius: 4px; }
.verdict.none { border-color: #2a8f4f; } .verdict.ambiguous, .verdict.unknown { border-color: #d2691e; }
.big { font-size: 1.25rem; } .quiet { color: #666; font-size: .9rem; }
table { border-collapse: collapse; background: #fff; width: 100%; font-size: .92rem; }
th, td { text-align: left; padding: .3rem .6rem; border-bottom: 1px solid #e4e4e4; }
td.number, th.number { text-align: right; font-variant-numeric: tabular-nums; }
.pictures { display: grid; grid-template-columns: repeat(auto-fit, minmax(480px, 1fr)); gap: .8rem; }
figure { margin: 0; background: #fff; padding: .5rem; border-radius: 4px; } figcaption { font-size: .85rem; }
.key span { display: inline-block; width: 1.4rem; height: 3px; margin: 0 .3rem .2rem .9rem; }
.bar { background: #e4e4e4; width: 8rem; height: .7rem; display: inline-block; border-radius: 3px; }
.bar i { background: #1f77b4; height: 100%; display: block; border-radius: 3px; }
"""


def render(diagnosis: Diagnosis) -> str:
    """The page as HTML."""
    finding = diagnosis.finding
    parts = [_verdict(diagnosis), _pictures(diagnosis), _causes(finding), _wrong(finding), _gain(finding),
             _limits(diagnosis)]
    title = f"Diagnosis of {diagnosis.measurement.name}"
    return ("<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">"
            f"<meta name=\"viewport\" content=\"width=device-width\"><title>{_text(title)}</title>"
            f"<style>{_STYLE}</style></head><body>\n<h1>{_text(title)}</h1>\n"
            f"<p class=\"quiet\">Vehicle {_text(diagnosis.car.source.name)} ({_text(diagnosis.car.source.variant)}), "
            f"{len(diagnosis.runs) + len(diagnosis.reserved)} recordings</p>\n"
            + "\n".join(part for part in parts if part) + "\n</body></html>\n")


def _text(value: object) -> str:
    return html.escape(str(value))


def _words(name: str) -> str:
    return name.replace("_", " ")


def _verdict(diagnosis: Diagnosis) -> str:
    finding = diagnosis.finding
    lines = [f"<p class=\"big\"><b>{_TITLES[finding['verdict']]}"]
    if finding["causes"] and finding["verdict"] in ("cause", "ambiguous"):
        lines.append(": " + _text("; ".join(_cause_sentence(c) for c in finding["causes"][:3])))
    lines.append("</b></p>")
    if finding["wrong"]:
        worst = "; ".join(f"{_words(w['signal'])}: {w['what']}" for w in _worst(finding["wrong"]))
        lines.append(f"<p>What the simulation gets wrong: {_text(worst)}.</p>")
    if finding["ambiguous_with"]:
        others = "; ".join(" with ".join(map(_words, a["effects"])) + f" ({a['separation_sigma']:.1f} sigma apart)"
                           for a in finding["ambiguous_with"][:4])
        lines.append(f"<p>What else it could be: {_text(others)}.</p>")
    if finding["unknown"]:
        unknown = finding["unknown"]
        lines.append(f"<p>The missing torque acts on the {_text(unknown['balance'])}, goes with "
                     f"{_text(unknown['driving_variable'])}, {_text(unknown['shape'])}; its size is "
                     f"{unknown['size']:.3g} N.m.</p>")
    if finding["next_manoeuvre"]:
        lines.append(f"<p>What to drive next: {_text(finding['next_manoeuvre']['why'])}.</p>")
    if finding["gain"]:
        rows = finding["gain"]["held_out"]
        before, after = (float(np.median([r[k] for r in rows])) for k in ("nrmse_before", "nrmse_after"))
        lines.append(f"<p>Gain on a recording that was not used: error {100 * before:.2g} % of the range before, "
                     f"{100 * after:.2g} % after (median over the signals).</p>")
    return f"<div class=\"verdict {finding['verdict']}\">{''.join(lines)}</div>"


def _worst(wrong: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """The first of each feature, three at most."""
    seen: dict[str, dict[str, Any]] = {}
    for entry in wrong:
        seen.setdefault(entry["feature"], entry)
    return list(seen.values())[:3]


def _cause_sentence(cause: dict[str, Any]) -> str:
    numbers = ", ".join(_number(name, p) for name, p in cause["parameters"].items())
    return f"{_words(cause['effect'])} ({numbers})"


def _number(name: str, p: dict[str, Any]) -> str:
    unit = "" if p["unit"] == "1" else f" {p['unit']}"
    change = f", {100 * (p['value'] / p['nominal'] - 1):+.0f} %" if p["nominal"] else ""
    return f"{_words(name)} {p['value']:.4g}{unit}{change}"


def _causes(finding: dict[str, Any]) -> str:
    if not finding["causes"]:
        return ""
    rows = []
    for cause in finding["causes"]:
        for i, (name, p) in enumerate(cause["parameters"].items()):
            share = cause["probability"]
            first = (f"<td><b>{_text(_words(cause['effect']))}</b></td><td><span class=\"bar\"><i style=\"width:"
                     f"{100 * min(share, 1.0):.0f}%\"></i></span> {100 * share:.0f} %</td>"
                     if i == 0 else "<td></td><td></td>")
            rows.append(f"<tr>{first}<td>{_text(_words(name))}</td><td class=number>{p['nominal']:.5g}</td>"
                        f"<td class=number><b>{p['value']:.5g}</b></td><td class=number>{p['low90']:.5g} to "
                        f"{p['high90']:.5g}</td><td>{_text(p['unit'])}</td></tr>")
    return ("<h2>Why: what explains it</h2><table><tr><th>cause</th><th>probability</th><th>parameter</th>"
            "<th class=number>file</th><th class=number>found</th><th class=number>90 % interval</th><th>unit</th></tr>"
            + "".join(rows) + "</table>")


def _wrong(finding: dict[str, Any]) -> str:
    if not finding["wrong"]:
        return "<h2>What is wrong</h2><p>No feature differs by more than a healthy car's would.</p>"
    rows = "".join(
        f"<tr><td>{_text(_words(w['signal']))}</td><td>{_text(w['what'])}</td><td class=number>{w['measured']:.4g}</td>"
        f"<td class=number>{w['simulated']:.4g}</td><td>{_text(w['unit'])}</td><td>{_text(w['where'])}</td>"
        f"<td class=number>{w['p_value']:.1g}</td></tr>" for w in finding["wrong"][:20])
    return ("<h2>What is wrong, feature by feature</h2><table><tr><th>signal</th><th>what</th><th class=number>measured"
            "</th><th class=number>simulated</th><th>unit</th><th>where</th><th class=number>p</th></tr>" + rows
            + "</table>")


def _gain(finding: dict[str, Any]) -> str:
    if not finding["gain"]:
        return ""
    rows = "".join(
        f"<tr><td>{_text(r['manoeuvre'])}</td><td>{_text(_words(r['signal']))}</td>"
        + "".join(f"<td class=number>{100 * r[k]:.2f} %</td>" for k in ("nrmse_before", "nrmse_after", "noise_floor"))
        + "</tr>" for r in finding["gain"]["held_out"])
    return ("<h2>The gain, on a recording that was not used</h2><table><tr><th>recording</th><th>signal</th>"
            "<th class=number>before</th><th class=number>after</th><th class=number>noise floor</th></tr>" + rows
            + "</table><p class=quiet>Root mean square error over the measured range.</p>")


def _limits(diagnosis: Diagnosis) -> str:
    if not diagnosis.notices:
        return ""
    return "<h2>What limits this</h2><ul>" + "".join(f"<li>{_text(n)}</li>" for n in diagnosis.notices) + "</ul>"


def _pictures(diagnosis: Diagnosis) -> str:
    """The channels of the run that was most wrong, worst first."""
    ranked = sorted(diagnosis.traces, key=lambda key: -_misfit(diagnosis.traces[key]))
    runs = list(dict.fromkeys(run for run, _ in ranked))[:2]
    chosen = [key for run in runs for key in [k for k in ranked if k[0] == run][:4]]
    key = "".join(f"<span style=\"background:{c}\"></span>{name}" for name, c in _COLOURS.items())
    figures = "".join(
        f"<figure><figcaption><b>{_text(_words(channel))}</b> [{_text(_unit(channel))}] &middot; {_text(run)}"
        f"</figcaption>{_picture(*diagnosis.traces[(run, channel)])}</figure>" for run, channel in chosen)
    return f"<h2>Measured, before and after <span class=key>{key}</span></h2><div class=pictures>{figures}</div>"


def _unit(channel: str) -> str:
    from cosim.measured import CANONICAL

    return CANONICAL[channel].unit


def _misfit(trace: tuple[np.ndarray, ...]) -> float:
    _, measured, before, _ = trace
    return float(np.sqrt(np.mean((measured - before) ** 2)) / (np.ptp(measured) or 1.0))


def _picture(clock: np.ndarray, measured: np.ndarray, before: np.ndarray, after: np.ndarray) -> str:
    """Three lines over time as inline SVG."""
    low, high = min(x.min() for x in (measured, before, after)), max(x.max() for x in (measured, before, after))
    span = (high - low) or 1.0
    left, bottom = 52, 20

    def points(values: np.ndarray) -> Iterable[str]:
        times = np.linspace(clock[0], clock[-1], min(_POINTS, clock.size))
        x = left + (_WIDTH - left - 6) * (times - clock[0]) / (clock[-1] - clock[0])
        y = (_HEIGHT - bottom) - (_HEIGHT - bottom - 6) * (np.interp(times, clock, values) - low) / span
        return (f"{a:.1f},{b:.1f}" for a, b in zip(x, y))

    lines = "".join(
        f"<polyline fill=\"none\" stroke=\"{_COLOURS[name]}\" stroke-width=\"{width}\" "
        f"points=\"{' '.join(points(v))}\"/>"
        for name, v, width in (("measured", measured, 2.2), ("before", before, 1.2), ("after", after, 1.2)))
    axis = "".join(f"<text x=\"{left - 4}\" y=\"{(_HEIGHT - bottom) - (_HEIGHT - bottom - 6) * f + 4:.0f}\" "
                   f"text-anchor=\"end\">{low + f * span:.4g}</text>" for f in (0.0, 0.5, 1.0))
    times = "".join(f"<text x=\"{left + (_WIDTH - left - 6) * f:.0f}\" y=\"{_HEIGHT - 5}\" text-anchor=\"middle\">"
                    f"{clock[0] + f * (clock[-1] - clock[0]):.1f}</text>" for f in (0.0, 0.25, 0.5, 0.75))
    return (f"<svg viewBox=\"0 0 {_WIDTH} {_HEIGHT}\" width=\"100%\" font-size=\"10\" fill=\"#666\" role=\"img\">"
            f"{axis}{times}<text x=\"{_WIDTH - 6}\" y=\"{_HEIGHT - 5}\" text-anchor=\"end\">time [s]</text>"
            f"{lines}</svg>")
