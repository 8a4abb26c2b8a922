"""The page of a plan: plan.html."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from jaxtyping import Float
from torch import Tensor

from contactlearn.core.numerics import number
from contactlearn.planning.result import Plan
from contactlearn.report.figures.browser import as_plotly
from contactlearn.report.figures.plan import plan_figure
from contactlearn.report.page.page import render, save
from contactlearn.report.page.trials import digits
from contactlearn.report.text.names import capitalize_first
from contactlearn.report.text.numbers import fine_percent
from contactlearn.report.text.plan import PURPOSES, plan_summary, possibility, setting

PLAN = "plan.html"


def write_plan_page(path: Path, plan: Plan, measured: Mapping[str, Float[Tensor, "n"]]) -> Path:
    """Write the page, whole or not at all; `measured` as `plan_figure` has it."""
    return save(path, render(of_plan(plan, measured), "plan.html.j2", scripts=("plan.js",)))


def of_plan(plan: Plan, measured: Mapping[str, Float[Tensor, "n"]]) -> dict[str, Any]:
    """Return everything that the page says and draws."""
    names = [name for name, one in plan.rig.items() if one.settable]
    shown = {name: setting(name) for name in names}
    said = plan_summary(plan)
    instruction = said.pop(0 if plan.stop else -1)
    said = said if plan.stop else said[1:]
    return {
        "title": f"The next {len(plan.drops)} drops" if plan.stop is None else "No more drops",
        "trials": None,
        "plan": True,
        "_stop": plan.stop is not None,
        "figures": {"design": digits(as_plotly(plan_figure(plan, measured)))},
        "_next": capitalize_first(instruction),
        "_said": [capitalize_first(line) for line in said if not line.startswith("  ") and line != "in question:"],
        "_possibilities": [(possibility(one), fine_percent(one.probability)) for one in plan.possibilities],
        "_columns": [f"{symbol} ({unit})" for symbol, unit, _ in shown.values()],
        "_drops": [
            ([number(drop.settings[name] * shown[name][2], 3) for name in names], PURPOSES[drop.purpose], drop.body)
            for drop in plan.drops
        ],
        "_looks": [(look.trials, ", ".join(look.found) or "–", ", ".join(look.probable) or "–") for look in plan.looks],
    }
