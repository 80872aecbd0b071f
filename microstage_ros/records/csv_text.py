"""Numbers to comma-separated text and back: with polars where it is installed, else with numpy.

polars is not among the packages that a ROS 2 distribution brings, so nothing may depend on it but
speed (two to three times that of `numpy.loadtxt`).
"""

import functools
import io
import re
import warnings

import numpy as np

EMPTY_FIELD = re.compile(rb"(?:(?<=,)|(?<=\n)|\A)(?=,|\n|\Z)")


@functools.cache
def polars_or_none():
    """The library, loaded when it is first needed: nodes read no CSV and start without it."""
    try:
        import polars
    except ImportError:
        return None
    return polars


def parse_rows(body, columns):
    """Rows of numbers as columns.

    Parameters
    ----------
    body : bytes, rows without header and comments, every row with the right number of fields.
    columns : number of fields in a row [1].

    Returns
    -------
    list of float64 arrays, each (rows,), NaN for an empty field.

    Raises
    ------
    ValueError : a field that is no number.
    """
    polars = polars_or_none()
    if polars is None:
        table = np.loadtxt(io.StringIO(EMPTY_FIELD.sub(b"nan", body).decode()), delimiter=",", ndmin=2, comments=None)
        return [np.ascontiguousarray(column) for column in table.T]
    names = [str(number) for number in range(columns)]
    try:
        with warnings.catch_warnings():  # about rows that are looked at here anyway
            warnings.simplefilter("ignore")
            table = polars.read_csv(io.BytesIO(body), has_header=False, schema=dict.fromkeys(names, polars.Float64))
    except polars.exceptions.PolarsError as error:
        raise ValueError(str(error)) from None
    return [table[name].fill_null(np.nan).to_numpy() for name in names]


def rows_text(columns):
    """Columns as rows of text, shortest digits that give the same number, NaN as an empty field.

    Parameters
    ----------
    columns : list of float64 arrays of one shape (n,).

    Returns
    -------
    bytes, every row ending in a line feed.
    """
    polars = polars_or_none()
    if polars is None:
        texts = [["" if value != value else repr(value) for value in column.tolist()]  # noqa: PLR0124 NaN alone differs
                 for column in columns]
        return "".join(",".join(row) + "\n" for row in zip(*texts)).encode()
    table = polars.DataFrame([polars.Series(str(number), column, nan_to_null=True)
                              for number, column in enumerate(columns)])
    return table.write_csv(include_header=False).encode()
