"""What flight and impacts say of the same parameter, and which of the two knows it better."""

from contactlearn.core.numerics import measured, number
from contactlearn.inference.identification.known import KnownParameter


def known_sentence(known: KnownParameter) -> str:
    """Say which of flight and impacts knows a parameter better, or that the impacts ask for more than flight allows."""
    flight, alone = (f"{measured(one.value, one.error, known.unit)}" for one in (known.flight, known.alone))
    both = f"{known.symbol} = {flight} from free flight, {alone} from the impacts alone"
    if known.contradicted and known.more:
        limit = f"the fit stops at the limit, {number(known.value, 3)}"
        why = "another effect acts in the same way, or other parameters are biased"
        return f"the impacts imply more {known.name} than free flight allows: {both}; {limit}; {why}"
    if known.contradicted:
        return f"the impacts imply less {known.name} than free flight shows: {both}"
    if known.better_in_flight:
        return f"free flight determines {known.name} more precisely than the impacts: {both}"
    return f"impacts and free flight agree on {known.name}: {both}"
