"""The tables of the benchmark: answers by group, criteria by trials and share, reliability of the confidence."""

import math
from collections import defaultdict
from collections.abc import Iterable, Sequence
from statistics import median

from second_nature.judge import Said, Score
from second_nature.truth import Asked

QUESTIONS = {
    "first": "first name",
    "exact": "exact set",
    "inside": "in the models",
    "false_name": "false name",
    "unknown": "unknown said",
    "variable": "right variable",
    "twins": "twins shown",
}
Z = 1.96


def wilson(right: int, of: int) -> tuple[float, float]:
    """The 95 % interval of a share after Wilson (1927)."""
    p, z2 = right / of, Z**2
    centre = (p + z2 / (2 * of)) / (1 + z2 / of)
    half = Z / (1 + z2 / of) * math.sqrt(p * (1 - p) / of + z2 / (4 * of**2))
    return max(0.0, centre - half), min(1.0, centre + half)


def share(answers: Sequence[bool]) -> str:
    """Right of all, with Wilson's interval in per cent."""
    if not answers:
        return ""
    low, high = wilson(sum(answers), len(answers))
    return f"{sum(answers)}/{len(answers)} ({100 * low:.0f}–{100 * high:.0f} %)"


def table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table of Markdown."""
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join(f"| {' | '.join(map(str, line))} |" for line in lines)


def _answers(scores: Iterable[Score], question: str) -> list[bool]:
    return [a for one in scores if (a := getattr(one, question)) is not None]


def by_group(said: Sequence[Said], scores: Sequence[Score]) -> str:
    """Every question by group, and over all."""
    groups = defaultdict(list)
    for one, points in zip(said, scores, strict=True):
        groups[one.group].append((one, points))
        groups["all"].append((one, points))
    rows = []
    for name in (*(g for g in groups if g != "all"), "all"):
        points, seconds = [p for _, p in groups[name]], [one.seconds for one, _ in groups[name]]
        cells = [share(_answers(points, question)) for question in QUESTIONS]
        rows.append([name, str(len(points)), *cells, f"{median(seconds):.1f} ({max(seconds):.1f})"])
    return table(["group", "sets", *QUESTIONS.values(), "seconds, median (max)"], rows)


CRITERIA = (
    # words, asked for, whether an effect of this many trials and share is meant
    ("n ≥ 300, share ≥ 15 %", 0.95, lambda n, s: n >= 300 and s >= 0.15),
    ("n ≤ 60, share ≥ 15 %", 0.85, lambda n, s: n <= 60 and s >= 0.15),
    ("n ≥ 150, share 5–15 %", 0.85, lambda n, s: n >= 150 and 0.05 <= s < 0.15),
    ("n 61–299, share ≥ 15 %", None, lambda n, s: 60 < n < 300 and s >= 0.15),
    ("the rest", None, lambda n, s: s < 0.05 or (n < 150 and s < 0.15)),
)


def criteria(said: Sequence[Said], scores: Sequence[Score]) -> str:
    """The first name right, by trials and share, over sets of known effects (engines, pairs and triples included)."""
    cases = [
        (one.n, one.truth["share"], points.first)
        for one, points in zip(said, scores, strict=True)
        if one.truth["asked"] == Asked.EXACT and points.first is not None
    ]
    rows = []
    for words, asked, holds in CRITERIA:
        answers = [first for n, s, first in cases if holds(n, s)]
        met = "" if asked is None or not answers else ("yes" if sum(answers) / len(answers) >= asked else "no")
        rows.append([words, "" if asked is None else f"{100 * asked:.0f} %", share(answers), met])
    return table(["first name right", "asked for", "measured", "met"], rows)


def reliability(said: Iterable[Said], scores: Iterable[Score]) -> str:
    """Named effects by tenths of their confidence: how many of them are in the set."""
    pairs = zip(said, scores, strict=True)
    return reliability_of((one.confidence[k], right) for one, points in pairs for k, right in points.named)


def reliability_of(names: Iterable[tuple[float, bool]]) -> str:
    """The same of confidences and of whether the names are right."""
    bins = defaultdict(list)
    for confidence, right in names:
        bins[min(int(10 * confidence), 9)].append((confidence, right))
    rows = [
        [f"{k / 10:.1f}–{(k + 1) / 10:.1f}", f"{sum(c for c, _ in b) / len(b):.3f}", share([r for _, r in b])]
        for k, b in sorted(bins.items())
    ]
    return table(["confidence", "mean", "right"], rows)


def wrong(said: Sequence[Said], scores: Sequence[Score]) -> str:
    """Every set with a wrong answer, of the half that may be looked at."""
    rows = []
    for one, points in zip(said, scores, strict=True):
        bad = [w for q, w in QUESTIONS.items() if getattr(points, q) is (q == "false_name")]
        if bad and one.half == "learn":
            hidden = " + ".join("/".join(accepted) for accepted in one.truth["effects"]) or "nothing"
            if one.truth["asked"] == Asked.UNKNOWN:
                hidden = f"unknown of {', '.join(one.truth['variables'])}"
            forms, heard = "; ".join(one.truth["forms"]), f"{' + '.join(one.forms) or 'nothing'} ({one.physics})"
            size = str(one.n), f"{one.truth['share']:.2f}"
            rows.append([one.name, *size, hidden, forms, heard, ", ".join(bad)])
    return table(["set", "n", "share", "hidden", "form", "said", "wrong"], rows)
