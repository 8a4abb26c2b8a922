"""What flight and impacts say of the same parameter, and which of the two knows it better."""

from contactlearn.core.numerics import measured, number
from contactlearn.inference.identification.known import KnownParameter


def known_sentence(known: KnownParameter) -> str:
    """Say which of flight and impacts knows a parameter better, or that the impacts ask for more than flight allows."""
    flight, alone = (f"{measured(one.value, one.error, known.unit)}" for one in (known.flight, known.alone))
    both = f"{known.symbol} = {flight} in flight, {alone} by the impacts alone"
    if known.contradicted and known.more:
        fitted = (
            f"the fit ends at {number(known.value, 3)}; another effect acts likewise, or other parameters are biased"
        )
        return f"the impacts ask for more {known.name} than flight allows: {both}; {fitted}"
    if known.contradicted:
        return f"the impacts ask for less {known.name} than flight has measured: {both}"
    if known.better_in_flight:
        return f"flight knows {known.name} better than the impacts: {both}"
    return f"impacts and flight agree on {known.name}: {both}"
