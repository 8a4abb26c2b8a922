"""A plan in words: what to do next, what it is expected to tell, and the columns of its table of drops."""

import math

from contactlearn.core.numerics import measured, number
from contactlearn.planning.result import Goal, Plan, Possibility, Purpose, Stop
from contactlearn.report.text.names import join_words, label
from contactlearn.report.text.numbers import fine_percent, percent

_DEGREES = 180 / math.pi
SETTINGS = {
    "height": ("Height", "mm", 1e3), "x": ("x", "mm", 1e3), "y": ("y", "mm", 1e3),
    "theta": ("θ", "°", _DEGREES), "heading": ("Heading", "°", _DEGREES), "turn": ("Turn", "°", _DEGREES),
    "omega": ("ω", "rad/s", 1.0),
}  # fmt: skip
"""Symbol, shown unit and factor of what a rig sets; of all others see `setting`."""
PURPOSES = {
    Purpose.NAMES: "tell names apart",
    Purpose.PARAMETERS: "determine parameters",
    Purpose.PREDICTION: "predict better",
    Purpose.EFFECTS: "show or exclude effects",
    Purpose.SPACE: "fill the space",
}
_SHOWN = 6  # possibilities
_STOPS = {
    Stop.SETTLED: "stop: two diagnoses in a row found the same names",
    Stop.NO_GAIN: "stop: the next drops were expected to tell too little, in two diagnoses in a row",
    Stop.BUDGET: "stop: the budget is used up: {more} drops beyond the {trials} impacts measured exceed its {budget}",
}


def setting(name: str) -> tuple[str, str, float]:
    """Return the symbol of a setting, the unit in which it is shown, and the factor from SI."""
    if name in SETTINGS:
        return SETTINGS[name]
    return name.replace("w_", "ω_"), "m/s" if name.startswith("v_") else "rad/s", 1.0


def plan_summary(plan: Plan) -> list[str]:
    """Say what the plan is and what is expected of it, line by line; of one that stops only why, and what is known."""
    question = [
        "in question:",
        *(f"  {fine_percent(x.probability)} {possibility(x)}" for x in plan.possibilities[:_SHOWN]),
    ]
    known = question if plan.possibilities else []
    if plan.stop:
        more, trials = len(plan.drops), plan.looks[-1].trials
        return [_STOPS[plan.stop].format(more=more, trials=trials, budget=plan.budget), *known]
    lines = [f"{len(plan.drops)} drops for {plan.goal if plan.possibilities else 'a first design'}"]
    chosen = [_limits(name, one.low, one.high) for name, one in plan.rig.items() if one.chosen]
    lines += [f"set by the rig: {join_words(chosen)}"]
    chance = [
        _limits(name, one.low, one.high) for name, one in plan.rig.items() if not one.settable and one.high > one.low
    ]
    lines += [f"by chance: {join_words(chance)}"] if chance else []
    lines += [*known, *forecast_lines(plan)]
    if plan.hidden:
        lines.append(f"no drop within these limits shows {join_words([label(name) for name in plan.hidden], 'or')}")
    return [*lines, "make these drops, then diagnose them together with all before them"]


def forecast_lines(plan: Plan) -> list[str]:
    """Say what is expected after the drops."""
    forecast, lines, batch = plan.forecast, list[str](), len(plan.drops)
    if forecast.right_name:
        now, after = forecast.right_name[:2]
        lines.append(
            f"probability of the most probable name: {percent(now)}, expected after the batch {percent(after)}"
        )
    for one in forecast.parameters if plan.goal is Goal.PARAMETERS else ():
        lines.append(
            f"{one.name}: {one.symbol} = {measured(one.value, one.error, one.unit)}, "
            f"expected ± {number(one.error_after, 2)}"
        )
    if forecast.error and plan.goal is Goal.PREDICTION:
        now, after = forecast.error[:2]
        lines.append(f"error of the prediction: {now:.2g} of the noise, expected after the batch {after:.2g}")
    if forecast.gain is not None:
        far = forecast.drops[-1]
        more = f"beyond {far} more drops" if forecast.worthwhile is None else f"up to {forecast.worthwhile} more drops"
        lines.append(
            "more drops are not expected to pay" if forecast.worthwhile == 0 else f"batches of {batch} pay {more}"
        )
    return lines


def _limits(name: str, low: float, high: float) -> str:
    symbol, unit, factor = setting(name)
    return f"{symbol} {number(low * factor, 3)} to {number(high * factor, 3)} {unit}"


def possibility(one: Possibility) -> str:
    """Write the effects that may be missing."""
    return join_words([label(name) for name in one.effects]) if one.effects else "no effect is missing"
