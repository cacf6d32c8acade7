"""Tables of a search's trials."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import fields

import numpy as np

from nvsdata.common.text import aligned
from nvsdata.emulation.settings import PIX2NVSSettings
from nvsdata.emulation.tuning.search import Measured, Search

# settings and their column headings: those of Table 3.3 of the thesis and alpha; below, those shown if trials differ
SHOWN = {"t_log": "T_log", "inhibition": "B", "max_events": "M_max", "threshold": "T_map", "new": "new", "exp": "exp"}
SHOWN |= {"alpha": "alpha"}
IF_VARIED = {"mode": "mode", "hue": "hue", "difference": "dif", "noise_rate": "noise"}
MEASURED = ("Inv. e-rep", "Chamfer", "EMD", "OFF apart", "ON apart")


def trials_table(search: Search, rows: int = 5, *, real: tuple[int, int] | None = None) -> str:
    """Return a table of trials, from the worst to the best, with the columns of Table 3.3 of the thesis.

    Args:
        search: A search.
        rows: Largest number of trials in the table, evenly spaced by rank; 1 shows the best.
        real: The camera's numbers of OFF and ON events, for the last row.
    """
    scores = search.scores
    ranked = [i for i in np.argsort(-scores, kind="stable") if np.isfinite(scores[i])]
    chosen = [ranked[round(i)] for i in np.linspace(len(ranked) - 1, 0, min(rows, len(ranked)))[::-1]]
    shown = _shown(search)
    measured = MEASURED[: len(search.best.distances)]
    lines: list[tuple[str, ...]] = [(*shown.values(), *measured, "Score", "OFF", "ON")]
    for i in chosen:
        trial = search.trials[i]
        values = [_short(getattr(trial.settings, name)) for name in shown]
        figures = (f"{value:.3f}" for value in (*trial.distances, scores[i]))
        lines.append((*values, *figures, *(f"{count:,}" for count in trial.events)))
    if real:
        lines.append(("camera", *[""] * (len(shown) + len(measured)), *(f"{count:,}" for count in real)))
    return aligned(lines)


def unseen_table(measured: Mapping[str, Measured], real: tuple[int, int]) -> str:
    """Return a table of distances and counts on parts that the search didn't use; the last row is the camera's."""
    most = max(len(one.distances) for one in measured.values())
    lines: list[tuple[str, ...]] = [("unseen part", *MEASURED[:most], "OFF", "ON")]
    for name, one in measured.items():
        lines.append((name, *(f"{value:.3f}" for value in one.distances), *(f"{count:,}" for count in one.events)))
    lines.append(("camera", *[""] * most, *(f"{count:,}" for count in real)))
    return aligned(lines)


def _shown(search: Search) -> dict[str, str]:
    """Return the names of the settings to show, and their headings."""
    kind = search.best.settings
    if not isinstance(kind, PIX2NVSSettings):
        names = [field.name for field in fields(kind)]
        return {name: name for name in _varied(search, names) or names}
    return {**{name: IF_VARIED[name] for name in _varied(search, IF_VARIED)}, **SHOWN}


def _varied(search: Search, names: Iterable[str]) -> list[str]:
    """Return those settings in which trials differ."""
    return [name for name in names if len({getattr(trial.settings, name) for trial in search.trials}) > 1]


def _short(value: object) -> str:
    return f"{value:.3g}" if isinstance(value, float) else str(value)
