"""Results as tables of pandas, which is loaded only where somebody asks for one."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal

from numpy.typing import NDArray

from rotary_error_monitor.arrays import Times
from rotary_error_monitor.errors import InputError, MissingPackageError, excerpt

if TYPE_CHECKING:
    from pandas import DataFrame

Units = Literal["SI", "um"]
"""Units of a table: `SI` for m and rad, `um` for µm and µrad."""

_MICRO = {"m": "µm", "rad": "µrad", "m/K": "µm/K", "rad/K": "µrad/K"}


def units_in(units: Units) -> tuple[float, Mapping[str, str]]:
    """Factor from SI units to those of a table, and the names of those that change, by the SI unit.

    Raises:
        InputError: there are no such units.
    """
    if units == "SI":
        return 1.0, {}
    if units == "um":
        return 1e6, _MICRO
    raise InputError(f"units is '{excerpt(units)}'; give 'SI' for m and rad, or 'um' for µm and µrad")


def scaled(units: Units, unit_of: Sequence[str], columns: Mapping[str, Sequence[float | None]]) -> dict[str, list[Any]]:
    """Columns of values, each row in a unit of its own, in the units of a table; with the column `unit` of their names.

    Args:
        units: of the table.
        unit_of: (n,) SI unit of each row.
        columns: (n,) values each, None where missing.

    Raises:
        InputError: there are no such units.
    """
    factor, names = units_in(units)
    factors = [factor if unit in names else 1.0 for unit in unit_of]
    found: dict[str, list[Any]] = {
        name: [math.nan if value is None else value * by for value, by in zip(values, factors, strict=True)]
        for name, values in columns.items()
    }
    return {**found, "unit": [names.get(unit, unit) for unit in unit_of]}


def table_over_time(stamp_ns: Times, columns: Mapping[str, NDArray[Any]], units: Mapping[str, str]) -> DataFrame:
    """Table with a row for each time: index `time` (UTC), units of its columns in `attrs["units"]`.

    Args:
        stamp_ns: (n,) timestamps (ns).
        columns: (n,) each.
        units: of the columns by their names.

    Raises:
        MissingPackageError: pandas is not installed.
    """
    pandas = _pandas()
    index = pandas.DatetimeIndex(stamp_ns.astype("datetime64[ns]"), tz="UTC", name="time")
    return _told(pandas.DataFrame(dict(columns), index=index), units)


def table_of_rows(columns: Mapping[str, Sequence[Any]], units: Mapping[str, str] | None = None) -> DataFrame:
    """Table with a row for each value; what is None is missing. Units and errors as `table_over_time`."""
    pandas = _pandas()
    frame = pandas.DataFrame({name: list(values) for name, values in columns.items()})
    whole = {name: "Int64" for name, values in columns.items() if _is_whole(values)}
    return _told(frame.astype(whole), units or {})


def _is_whole(values: Sequence[Any]) -> bool:
    """Whether there are whole numbers alone, and what is missing."""
    kinds = {type(value) for value in values}
    return int in kinds and kinds <= {int, type(None)}


def _told(frame: DataFrame, units: Mapping[str, str]) -> DataFrame:
    frame.attrs["units"] = dict(units)
    return frame


def _pandas() -> Any:  # noqa: ANN401  # pandas has no types here
    try:
        import pandas
    except ImportError as error:
        raise MissingPackageError(
            "tables need the package pandas: pip install 'rotary_error_monitor[notebook]'"
        ) from error
    return pandas
