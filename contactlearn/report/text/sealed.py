"""The sealed account of mystery drops in words."""

import textwrap
from collections.abc import Mapping
from typing import Any


def account(truth: Mapping[str, Any]) -> str:
    """Write what was hidden: law, parameters, noise and effects; `data.mystery.reveal` returns it."""
    noise, effects = truth["noise"], truth["effects"]
    lines = [
        f"Mystery drops, seed {truth['seed']}, {truth['size']} drops",
        f"law    {truth['law']} with μ = {truth['mu']:.4f}, ε = {truth['eps']:.4f}",
        f"noise  σ = {noise['v']:.4f} m/s on v_x and v_y, {noise['omega']:.3f} rad/s on ω, before and after contact",
        f"hidden {', '.join(effect['name'] for effect in effects) or 'nothing'}",
    ]
    for effect in effects:
        values = effect["parameters"].items()
        parameters = ", ".join(f"{symbol} = {value:.4g} {effect['units'][symbol]}".rstrip() for symbol, value in values)
        lines += [
            "",
            effect["name"],
            textwrap.fill(effect["form"], 100, initial_indent="  ", subsequent_indent="  "),
            f"  {parameters}",
            f"  changes the outcome by {100 * effect['relative_change']:.2f} % (rms, mass norm)",
        ]
    return "\n".join(lines)
