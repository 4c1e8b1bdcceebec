"""Pictures of a diagnosis: what was measured and simulated, and what is missing over what it could go with."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
from markupsafe import Markup

from cosim.diagnosis.show.features import WITH_RINGING, WITHOUT_PLACE
from cosim.measured import CANONICAL
from cosim.report import svg
from cosim.report.diagnosis.text import dotted, shown_unit, words

_PICTURES = 4
_OVER = 4  # pictures of what is missing
# Of what a missing torque may go with.
_UNITS = {"speed": "m/s", "shaft torque": "N.m", "engine torque": "N.m", "twist": "rad", "wheel angle": "rad",
          "time": "s", "distance": "m"}


def over_time(wrong: Sequence[Mapping[str, Any]], traces: Mapping[tuple[str, str], Sequence[np.ndarray]],
              right: Collection[str] = ()) -> list[dict[str, Any]]:
    """What is wrong first, each where it shows; beside it the other channels, the worst first.

    What is wrong in so many recordings that ``where`` lists them no more is shown in the one that it is worst in.

    Args:
        wrong: As the finding has it.
        traces: Run, channel to clock, measured, before, after.
        right: Recordings that were examined with nothing found: of other channels nothing is said elsewhere. Not all
            that they may be off by is looked at one by one, nor is anything of recordings that were kept back.
    """
    worst = sorted(traces, key=lambda key: -_misfit(traces[key]))
    chosen: dict[tuple[str, str], dict[str, Any]] = {}
    for entry in wrong:
        key = (entry.get("run", entry["where"].partition(",")[0]), entry["signal"].partition(" over ")[0])
        if key not in traces:
            key = next((other for other in worst if other[1] == key[1]), key)
        if key in traces and key[1] not in {channel for _, channel in chosen}:
            chosen[key] = dict(entry)
    named = {name for entry in wrong for name in entry["signal"].split(" over ")}
    count = min(len(chosen) + len(chosen) % 2, _PICTURES) if chosen else _PICTURES
    for key in worst:
        if len(chosen) < count and key[1] not in named | {channel for _, channel in chosen}:
            chosen[key] = _beside(key, wrong, right)
    found = []
    for (run, channel), entry in list(chosen.items())[:_PICTURES]:
        clock, measured, before, after = traces[(run, channel)]
        values = {"measured": measured, "before": before}
        if after is not None and not np.array_equal(before, after):
            values["after"] = after
        title = f"{words(channel)} in {run}"
        found.append({"signal": words(channel), "unit": shown_unit(CANONICAL[channel].unit), "run": run,
                      "what": dotted(entry["what"]), "after": "after" in values,
                      "svg": Markup(svg.over_time(clock, values, _window(entry, clock, measured, before), title))})
    return found


def _beside(key: tuple[str, str], wrong: Sequence[Mapping[str, Any]], right: Collection[str]) -> dict[str, Any]:
    """What is said of a channel of which nothing is listed: how a speed drifts is, of one for all of them."""
    run, channel = key
    if channel.endswith("speed"):
        for entry in wrong:
            if entry.get("feature") == "drift" and run in entry.get("runs", [entry.get("run")]):
                said = f"goes with {words(entry['signal'])}, of which it is said: {entry['what']}"
                return {"what": said, "feature": "drift"}
    return {"what": "no more off than tolerance and noise explain" if run in right else ""}


def _misfit(trace: Sequence[np.ndarray]) -> float:
    _, measured, before, _ = trace
    return float(np.sqrt(np.mean((measured - before) ** 2)) / (np.ptp(measured) or 1.0))


def _window(entry: Mapping[str, Any], clock: np.ndarray, measured: np.ndarray, before: np.ndarray) -> svg.Window:
    """The span that shows it: where it rings, where most changes, or all of it."""
    start, stop = float(clock[0]), float(clock[-1])
    feature = entry.get("feature")
    if feature in WITHOUT_PLACE:
        return start, stop
    if feature in WITH_RINGING:
        return max(start, entry["begin"] - 0.7), min(stop, entry["end"] + 0.3)
    late = feature in ("lag", "lag behind the others")
    length = 1.6 if late or feature == "reversal dead time" else 2.6
    if stop - start <= length:
        return start, stop
    liveliness = np.abs(np.gradient(before, clock)) if late else np.abs(measured - before)
    even = np.linspace(start, stop, 400)
    smooth = np.convolve(np.interp(even, clock, liveliness), np.ones(41), "same")
    middle = float(np.clip(even[int(np.argmax(smooth))], start + 0.5 * length, stop - 0.5 * length))
    return middle - 0.5 * length, middle + 0.5 * length


def what_is_missing(unknown: Mapping[str, Any] | None, table: Mapping[str, Any],
                    runs: Sequence[str]) -> list[dict[str, Any]]:
    """What is missing over what it could go with; the variable it does go with first, run by run if each differs."""
    if not unknown or not table:
        return []
    torque = np.asarray(table["torque"])
    own = unknown["driving_variable"]
    variables = [name for name, values in table.items()
                 if name not in ("torque", "std", "run") and np.shape(values) == torque.shape and np.ptp(values) > 0.0]
    wanted = [(name, "") for name in sorted(variables, key=lambda name: name != own)]
    if unknown.get("each_its_own"):
        wanted = [(own, run) for run in runs] + wanted[1:]
    pictures = []
    for name, run in wanted[:max(_OVER, len(runs))]:
        inside = np.asarray(table["run"]) == runs.index(run) if run else np.ones(torque.size, dtype=bool)
        values = np.asarray(table[name])[inside]
        if name.endswith("angle"):
            values = values % (2.0 * np.pi)
        below = f"{words(name)} [{shown_unit(_UNITS[name])}]" if name in _UNITS else words(name)
        pictures.append({"name": words(name), "run": run, "first": name == own, "svg": Markup(
            svg.scatter(values, torque[inside], below, f"what is missing over {words(name)} {run}".strip()))})
    return pictures
