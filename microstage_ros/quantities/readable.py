"""Numbers with their units as people read them: prefixes for exponents, digits as the uncertainty lets stand."""

import math
import re

import numpy as np
from numpy.typing import ArrayLike

PREFIXES = {-15: "f", -12: "p", -9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G"}
TAKES_PREFIX = re.compile(r"(?!kg|g cm|1|dB|deg|periods)[A-Za-zΩ]+(?![\^²³\w])")
"""Units that a prefix may stand before: not kg, not g cm², not areas, not pure numbers, degrees and periods."""


SIGNS = (("ohm", "Ω"), ("^2", "²"), ("^3", "³"), ("degC", "°C"))
"""Names of units in files to the signs that people read."""

CUSTOMARY = {"kg m²": (1.0e-3, 1.0e7, "g cm²")}
"""Units of which small numbers (below the first, in SI) are read in another: its number of the SI one, its sign."""


def unit_sign(unit: str) -> str:
    """A unit of a file as people write it: ``kg m^2`` as kg m², ``ohm`` as Ω."""
    for name, sign in SIGNS:
        unit = unit.replace(name, sign)
    return unit


def exponent_of(size: float) -> int:
    """Exponent of ten, a multiple of three from −15 to 9, whose prefix suits a number of this ``size`` [any unit]."""
    if size == 0.0 or not math.isfinite(size):
        return 0
    return min(max(3 * math.floor(math.log10(size * (1 + 1e-9)) / 3), -15), 9)


def quantity(value: float | None, unit: str, digits: int = 3, stderr: float | None = None) -> str:
    """A value with unit as people write it: `160 nm`, `17.0 ± 0.5 mrad`, a dash for no value.

    Parameters
    ----------
    value, stderr : in `unit`, SI; digits : significant ones, where no stderr tells how many.
    """
    if value is None or not math.isfinite(value):
        return "–"
    unit, factor = _customary(unit_sign(unit), abs(value))
    value, stderr = value * factor, stderr * factor if stderr else stderr
    exponent = exponent_of(max(abs(value), stderr or 0.0)) if TAKES_PREFIX.match(unit) else 0
    name = "" if unit in ("", "1") else f" {PREFIXES[exponent]}{unit}"
    scaled = value / 10.0**exponent
    if not stderr or not math.isfinite(stderr):
        return _plain(scaled, digits) + name
    spread = stderr / 10.0**exponent
    if spread < 1e-4 or spread >= 1e6:
        return f"{_plain(scaled, 4)} ± {_plain(spread, 2)}{name}"
    decimals = max(0, 1 - math.floor(math.log10(spread) + 1e-9))
    return f"{scaled:.{decimals}f} ± {spread:.{decimals}f}{name}".replace("-", "−")


def people(value: ArrayLike | None, unit: str, stderr: ArrayLike | None = None, between: str = "; ") -> str:
    """A number or several with their unit as people read them: ``10.6 ± 0.2 µN m``, a dash where there is none.

    Parameters
    ----------
    value, stderr : in ``unit``, SI, of the same shape (n,) or scalars, or None. between : stands between two numbers.
    """
    if value is None:
        return "–"
    values = np.atleast_1d(value)
    spreads = np.full(len(values), None) if stderr is None else np.atleast_1d(stderr)
    return between.join(quantity(float(v), unit, 4, None if s is None else float(s)) for v, s in zip(values, spreads))


def _plain(value: float, digits: int) -> str:
    """A number with so many significant digits and no exponent where that is readable."""
    if value == 0:
        return "0"
    decimals = digits - 1 - int(f"{value:.{digits - 1}e}".partition("e")[2])
    text = f"{value:.{max(decimals, 0)}f}" if -4 < decimals < 9 else f"{value:.{digits - 1}e}"
    return re.sub(r"e([+-])0*", r"e\1", text).replace("e+", "e").replace("-", "−")


def interval(low: float, high: float, unit: str, digits: int = 3) -> str:
    """Both ends of an interval with one prefix: ``−0.68 … −0.50 mH``; with one end open ``above 2.00 mm``.

    Parameters
    ----------
    low, high : in `unit`, SI; may be infinite. digits : significant ones of a single end; two ends have as many
        decimals as give their distance two digits.
    """
    unit, factor = _customary(unit_sign(unit), max(abs(end) for end in (low, high)))
    low, high = low * factor, high * factor
    ends = [abs(end) for end in (low, high) if math.isfinite(end)]
    exponent = exponent_of(max(ends, default=0.0)) if TAKES_PREFIX.match(unit) else 0
    name = "" if unit in ("", "1") else f" {PREFIXES[exponent]}{unit}"
    if not ends:
        return "anything"
    texts = [_plain(end / 10.0**exponent, digits) for end in (low, high) if math.isfinite(end)]
    if len(texts) == 1:
        return f"{'above' if math.isfinite(low) else 'below'} {texts[0]}{name}"
    width = (high - low) / 10.0**exponent
    decimals = max(0, 1 - math.floor(math.log10(width))) if width > 0.0 else 9
    if decimals < 9:
        texts = [f"{end / 10.0**exponent:.{decimals}f}".replace("-", "−") for end in (low, high)]
    return f"{texts[0]} … {texts[1]}{name}"


def _customary(unit: str, size: float) -> tuple[str, float]:
    """(unit, its number of the given one) in which a number of this size is read."""
    least, factor, name = CUSTOMARY.get(unit, (0.0, 1.0, unit))
    return (name, factor) if size < least else (unit, 1.0)
