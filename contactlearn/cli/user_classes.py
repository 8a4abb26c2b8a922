"""Laws and effects of the user's own, checked on a few drops before any work: a mistake is one line at the start.

A class that passes may still break a rule; `contactlearn.testing` has the whole contract.
"""

import inspect
import traceback
from collections.abc import Generator
from contextlib import contextmanager, suppress
from itertools import chain

import torch
from torch import Tensor

from contactlearn.cli.job import reason
from contactlearn.core.errors import ContactLearnError
from contactlearn.effects import Effect
from contactlearn.effects.checks import describe, lost_gradients, violations
from contactlearn.laws import Contact, Law
from contactlearn.simulation import synthetic

_DROPS, _MU, _EPS = 5, 0.2, 0.5
_ROUNDING = 1e-9  # m/s and rad/s
_NO_IF = "; a parameter has many values at once: torch.where(condition, a, b) takes the place of if"


@contextmanager
def located_errors(target: object, kind: type) -> Generator[None]:
    """Turn any error of a class into one that names the place in its file.

    Raises:
        ContactLearnError: with the class, the method, the line and the error.
    """
    try:
        yield
    except ContactLearnError:
        raise
    except Exception as error:  # whatever code of the user's own may raise
        frames = traceback.extract_tb(error.__traceback__)
        own = [frame for frame in frames if frame.filename == inspect.getfile(kind)]
        where = (own or frames)[-1]
        hint = _NO_IF if str(error).startswith("Boolean value of Tensor") else ""
        message = f"{target} fails in {where.name}, line {where.lineno}: {reason(error)}{hint}"
        raise ContactLearnError(message) from error


def check_effect(effect: Effect, target: object) -> None:
    """Use an effect on a few drops, unless they are none for it.

    Raises:
        ContactLearnError: it has no parameter, returns something else than its method should, changes the outcome
            where it vanishes, or depends on a parameter without a gradient.
    """
    drops = synthetic.load(size=_DROPS)
    broken = None
    with suppress(ContactLearnError):  # an effect may need other drops
        effect = effect.prepare(drops)
        rules = chain(violations(effect, drops, rounding=_ROUNDING), lost_gradients(effect, drops))
        broken = next(rules, None)
    if broken:
        raise ContactLearnError(f"{target} {broken}")


def check_law(law: Law, target: object) -> None:
    """Use a law on a few contacts, with several coefficients at once.

    Raises:
        ContactLearnError: it returns something else than two tensors of impulses, or no numbers.
    """
    drops = synthetic.load(size=_DROPS)
    mu, eps = (torch.tensor(values, dtype=torch.float64)[:, None] for values in ((0.1, _MU), (0.3, _EPS)))
    contact = Contact(drops.W[:, 0, 0], drops.W[:, 0, 1], drops.W[:, 1, 1], *drops.v_c.unbind(-1))
    returned: object = law.solve(contact, mu, eps)
    pair = isinstance(returned, tuple | list) and len(returned) == 2
    if not pair or not all(isinstance(part, Tensor) for part in returned):
        raise ContactLearnError(
            f"{target}.solve must return two tensors (P_t, P_n) of impulses, got {describe(returned)}"
        )
    if not law.at(mu, eps).impulse(drops.W, drops.v_c).isfinite().all():
        raise ContactLearnError(f"{target}.solve gives an impulse that is no finite number on ordinary contacts")
