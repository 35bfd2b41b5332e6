"""What a twin predicts is finite, or it is said what makes it so large that nothing can be predicted."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.effects.effect import Cause
from rotary_error_monitor.errors import InputError


class UnpredictableError(InputError):
    """A twin, or a twin with effects of some size, gives numbers that are not finite.

    Where the effects are what makes it so, another size of them can do: a fit takes a smaller step.
    """


def check_finite(
    signal: str, values: NDArray[np.float64] | NDArray[np.complex128], causes: Sequence[Cause] = ()
) -> None:
    """Refuse predicted values that are not finite.

    Args:
        signal: what they are of, such as `head_a`.
        values: of any shape.
        causes: effects in the prediction.

    Raises:
        UnpredictableError: a value is NaN or infinite; the message names the effects with their values, if any.
    """
    finite = np.isfinite(values)
    if finite.all():
        return
    count = int(np.count_nonzero(~finite))
    if causes:
        sizes = "; ".join(f"{' at '.join(filter(None, cause.key))} of {_told(cause)}" for cause in causes)
        reason = f"with {sizes}; effects of this size cannot be predicted on this stage or machine"
    else:
        reason = (
            "from its description alone; what it describes must be far smaller than the part that it acts on (an "
            "eccentricity than the ring's radius), and recorded force and temperature those of a machine"
        )
    raise UnpredictableError(f"twin: {signal} gets values that are not finite ({count} of {values.size}) {reason}")


def _told(cause: Cause) -> str:
    places = cause.effect.slices().items()
    return ", ".join(f"{name} {', '.join(f'{v:g}' for v in cause.values[place])}" for name, place in places)
