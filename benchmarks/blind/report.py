"""Tables of the scores: by group, by trials and share, stated probabilities, false names, and wrong answers."""

import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import median

from blind.judge import Answer, Score, Truth, false_names, read_truth, score

QUESTIONS = {
    "first": "first name",
    "exact": "exact set",
    "simpler": "exact, or the simpler model",
    "plausible": "among the plausible models",
    "no_false_name": "no false name",
    "false_unknown": "falsely called unknown",
    "unknown": "called unknown",
    "acceptable": "unknown, or acceptable names only",
    "dependence": "right coefficient or variable",
    "follows": "right coefficient and what it follows",
    "confounded": "confounded effects listed",
    "bad_data": "right about bad data",
    "correction": "right correction",
    "parameters": "planted parameters",
    "planted": "planted change",
}
Z = 1.96


def wilson(right: int, of: int) -> tuple[float, float]:
    """Compute the 95 % interval of a share (Wilson 1927)."""
    p, z2 = right / of, Z**2
    centre = (p + z2 / (2 * of)) / (1 + z2 / of)
    half = Z / (1 + z2 / of) * math.sqrt(p * (1 - p) / of + z2 / (4 * of**2))
    return max(0.0, centre - half), min(1.0, centre + half)


def share(answers: Sequence[bool]) -> str:
    """Format right of all, with Wilson's interval in per cent."""
    if not answers:
        return ""
    low, high = wilson(sum(answers), len(answers))
    return f"{sum(answers)}/{len(answers)} ({100 * low:.0f}–{100 * high:.0f} %)"


def table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Format a Markdown table."""
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join(f"| {' | '.join(map(str, line))} |" for line in lines)


@dataclass(frozen=True)
class Judged:
    """An answer with the truth and its score."""

    answer: Answer
    truth: Truth
    score: Score


def judged(answers: Iterable[Answer], truths: Callable[[str], Mapping[str, Truth]] = read_truth) -> list[Judged]:
    """Score answers, in the order of their suites, against the truths of each suite by name."""
    by_name = {(one.suite, one.name): one for one in answers}
    return [
        Judged(by_name[suite, name], truth, score(by_name[suite, name], truth))
        for suite in dict.fromkeys(suite for suite, _ in by_name)
        for name, truth in truths(suite).items()
        if (suite, name) in by_name
    ]


def report(answers: Iterable[Answer]) -> str:
    """Format all tables."""
    sets = judged(answers)
    if not sets:
        return "no set is finished"
    parts = [by_group(sets), by_size(sets), reliability(sets), beside_unknown(sets), wrong(sets)]
    late = [one.answer.name for one in sets if not one.answer.complete]
    late_words = f"The search ran out of time on {len(late)} sets: {', '.join(late)}" if late else ""
    return "\n\n".join(filter(None, [*parts, late_words]))


def _total(truth: Truth) -> str | None:
    """Return the row in which a set is counted beside its group."""
    if truth.question == "effects":
        return "all with known effects only"
    if truth.question == "unknown":
        return "all unknown serial dependence" if truth.follows else "all other unknown physics"
    return None


def by_group(sets: Sequence[Judged]) -> str:
    """Tabulate every question by group and over groups, and the time."""
    groups: dict[str, list[Judged]] = defaultdict(list)
    totals: dict[str, list[Judged]] = defaultdict(list)
    for one in sets:
        groups[one.truth.group].append(one)
        if (total := _total(one.truth)) is not None:
            totals[total].append(one)
    several = {name: some for name, some in totals.items() if len({one.truth.group for one in some}) > 1}
    unknown = [one for one in sets if one.truth.question == "unknown"]
    if len({bool(one.truth.follows) for one in unknown}) > 1:
        several["all unknown physics"] = unknown
    questions = [question for question in QUESTIONS if _answers(sets, question)]
    rows = [
        [name, str(len(some)), *(share(_answers(some, question)) for question in questions), _seconds(some)]
        for name, some in (groups | several | {"all": list(sets)}).items()
    ]
    return table(["group", "sets", *(QUESTIONS[question] for question in questions), "seconds, median (max)"], rows)


def _answers(sets: Iterable[Judged], question: str) -> list[bool]:
    return [answer for one in sets if (answer := getattr(one.score, question)) is not None]


def _seconds(sets: Sequence[Judged]) -> str:
    seconds = [one.answer.seconds for one in sets]
    return f"{median(seconds):.1f} ({max(seconds):.1f})"


SIZES: dict[str, Callable[[int, float], bool]] = {
    "n ≥ 300, share ≥ 15 %": lambda n, share: n >= 300 and share >= 0.15,
    "n ≤ 60, share ≥ 15 %": lambda n, share: n <= 60 and share >= 0.15,
    "n ≥ 150, share 5–15 %": lambda n, share: n >= 150 and 0.05 <= share < 0.15,
    "n 61–299, share ≥ 15 %": lambda n, share: 60 < n < 300 and share >= 0.15,
    "the rest": lambda n, share: share < 0.05 or (n < 150 and share < 0.15),
}
"""Classes of known effects by the number of trials and their share of the law's error."""


def by_size(sets: Sequence[Judged]) -> str:
    """Tabulate right first names of known effects by trials and share, where the shares are known."""
    cases = [one for one in sets if one.truth.question == "effects" and one.truth.share is not None]
    if not cases:
        return ""
    rows = []
    for words, holds in SIZES.items():
        some = [one for one in cases if holds(one.truth.n, one.truth.share or 0.0)]
        rows.append([words, share(_answers(some, "first")), share(_answers(some, "exact"))])
    return table(["known effects", "first name", "exact set"], rows)


def reliability(sets: Sequence[Judged]) -> str:
    """Tabulate names by tenths of their stated probability: without unknown physics, beside it, and all."""
    unknown = [one for one in sets if one.truth.question == "unknown"]
    known = [one for one in sets if one.truth.question != "unknown"]
    return reliability_of(
        {
            f"names {where}": probabilities(some)
            for where, some in (("of known physics", known), ("beside unknown physics", unknown), ("in all", sets))
        }
    )


def probabilities(sets: Iterable[Judged]) -> list[tuple[float, bool]]:
    """Return the stated probability of each judged name, and whether it is right."""
    return [(one.answer.confidence[k], right) for one in sets for k, right in one.score.named]


def reliability_of(columns: dict[str, list[tuple[float, bool]]]) -> str:
    """Tabulate stated probabilities against shares of right names, in tenths."""
    bins = {name: defaultdict[int, list[tuple[float, bool]]](list) for name in columns}
    for name, pairs in columns.items():
        for stated, right in pairs:
            bins[name][min(int(10 * stated), 9)].append((stated, right))
    rows = []
    for k in sorted({k for some in bins.values() for k in some}):
        row = [f"{k / 10:.1f}–{(k + 1) / 10:.1f}"]
        for some in bins.values():
            pairs = some.get(k, [])
            row += [
                f"{sum(p for p, _ in pairs) / len(pairs):.3f}" if pairs else "",
                share([right for _, right in pairs]),
            ]
        rows.append(row)
    header = [cell for name in columns for cell in (f"{name}: mean stated", "right")]
    return table(["stated", *header], rows)


def beside_unknown(sets: Sequence[Judged]) -> str:
    """Tabulate false names beside unknown physics, as given and with the candidates."""
    unknown = [one for one in sets if one.truth.question == "unknown"]
    if not unknown:
        return ""
    rows = []
    for words, more in (("as named", False), ("with candidates", True)):
        false = [
            false_names([*one.answer.effects, *(one.answer.candidates if more else [])], one.truth) for one in unknown
        ]
        rows.append([words, str(sum(map(len, false))), share([not names for names in false])])
    return table(["names beside unknown physics", "false names", "sets without any"], rows)


def wrong(sets: Sequence[Judged]) -> str:
    """List every wrong answer, but for those of sets that are only reported."""
    rows = []
    for one in sets:
        answer, truth = one.answer, one.truth
        bad = [words for name, words in QUESTIONS.items() if getattr(one.score, name) is (name == "false_unknown")]
        if bad and truth.half != "report":
            size = "" if truth.share is None else f"{truth.share:.2f}"
            accepted = " + ".join("/".join(names) for names in truth.accepted)
            hidden = "; ".join(filter(None, [" + ".join(truth.hidden), accepted])) or "nothing"
            said = f"{' + '.join(answer.forms) or 'nothing'} ({', '.join([answer.verdict, *answer.corrections])})"
            row = [one.answer.name, str(truth.n), size, hidden, f"{said} {answer.error}".strip(), _remains(answer)]
            rows.append([*row, ", ".join(bad)])
    return table(["set", "n", "share", "hidden", "named", "residual", "wrong"], rows) if rows else ""


def _remains(answer: Answer) -> str:
    """Describe what the residual depends on."""
    words = [f"depends on {', '.join(answer.variables)}"] if answer.variables else []
    if (serial := answer.serial_dependence) is not None:
        words.append(
            f"{serial['coefficient'] or 'outcome'} follows {serial['follows']} ({100 * serial['share']:.1f} %)"
        )
    if (state := answer.state_dependence) is not None:
        driven = ", ".join(state["variables"])
        words.append(f"{state['coefficient'] or 'outcome'} depends on {driven} ({100 * state['share']:.1f} %)")
    return "; ".join(words)
