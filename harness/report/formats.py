"""Numbers as the report prints them: one place, so that tables, captions and sentences agree."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from fractions import Fraction

MINUS = "\N{MINUS SIGN}"
NBSP = "\N{NO-BREAK SPACE}"
PLUS_MINUS = f"{NBSP}±{NBSP}"
TIMES = f"{NBSP}×"
MISSING = "–"

# Below this a percentage has three decimals: a tenth of the gates' tolerance is then still visible.
_FINE_PERCENT = 2.0
# From here on a percentage says "wrong" and its decimals say nothing.
_COARSE_PERCENT = 20.0


def number(value: float, decimals: int, *, sign: bool = False) -> str:
    """`value` with fixed decimals, thousands separated, a true minus sign; a dash where it is not finite."""
    if not math.isfinite(value):
        return MISSING
    text = f"{value:{'+' if sign else ''},.{decimals}f}"
    if float(text.replace(",", "")) == 0:  # a zero after rounding has no sign to speak of
        text = text.lstrip("+-")
    return text.replace("-", MINUS)


def significant(value: float, digits: int = 3) -> str:
    """`value` rounded to significant digits without an exponent where that stays short, else as 1.2×10⁻⁵."""
    if not math.isfinite(value):
        return MISSING
    if value == 0:
        return "0"
    exponent = math.floor(math.log10(abs(float(f"{value:.{digits - 1}e}"))))
    if -4 <= exponent < 7:
        return number(round(value, digits - 1 - exponent), max(0, digits - 1 - exponent))
    mantissa = number(value / 10.0**exponent, digits - 1)
    return f"{mantissa}×10{str(exponent).translate(_SUPERSCRIPTS)}"


def percent_decimals(size: float) -> int:
    """Decimals that a percentage of this size (in percent) deserves: three, one or none."""
    if not math.isfinite(size):
        return 1
    return 3 if abs(size) < _FINE_PERCENT else 1 if abs(size) < _COARSE_PERCENT else 0


def percent(fraction: float, *, sign: bool = False, unit: bool = True, decimals: int | None = None) -> str:
    """A measured fraction as a percentage: 0.0003 -> '+0.030 %'; decimals as its size deserves, or so many."""
    value = 100.0 * fraction
    text = number(value, percent_decimals(value) if decimals is None else decimals, sign=sign)
    return f"{text}{NBSP}%" if unit and text != MISSING else text


def share(fraction: float, *, unit: bool = True) -> str:
    """A fraction that somebody chose, as short as it was chosen: 0.95 -> '95 %'."""
    return f"{100 * fraction:g}{NBSP}%" if unit else f"{100 * fraction:g}"


def tolerance(fraction: float) -> str:
    """A bound that somebody chose on either side: 0.002 -> '±0.2 %'."""
    return f"±{share(fraction)}"


def fraction(value: float) -> str:
    """A ratio of small whole numbers as it is written: −0.75 -> '−3/4', 0.2 -> '1/5'."""
    return str(Fraction(value).limit_denominator(100)).replace("-", MINUS)


def levels(fractions: Iterable[float]) -> str:
    """Levels of confidence, each once: '95 % and 99 %'."""
    return words([share(fraction) for fraction in sorted(set(fractions))])


def percent_interval(fraction: float, low: float, high: float, *, unit: bool = True) -> str:
    """A signed fraction and its interval: '+0.031 % ± 0.050 %', or '+3.1 % [+1.0, +9.4] %' where it is lopsided."""
    value, down, up = 100.0 * fraction, 100.0 * (fraction - low), 100.0 * (high - fraction)
    suffix = f"{NBSP}%" if unit else ""
    if not (math.isfinite(down) and math.isfinite(up)):
        return percent(fraction, sign=True, unit=unit)
    decimals = min(percent_decimals(value), percent_decimals(max(down, up)))
    centre = number(value, decimals, sign=True)
    if abs(up - down) <= 0.1 * (up + down) or up + down < 0.001:
        return f"{centre}{suffix}{PLUS_MINUS}{number((up + down) / 2, decimals)}{suffix}"
    return (f"{centre}{suffix}{NBSP}[{number(100 * low, decimals, sign=True)},{NBSP}"
            f"{number(100 * high, decimals, sign=True)}]{suffix}")


def interval(value: float, low: float, high: float, decimals: int) -> str:
    """A value and its interval with fixed decimals: '−0.500 [−0.512, −0.488]'."""
    if not (math.isfinite(low) and math.isfinite(high)):
        return number(value, decimals)
    return f"{number(value, decimals)}{NBSP}[{number(low, decimals)},{NBSP}{number(high, decimals)}]"


def ratio(value: float, low: float, high: float) -> str:
    """A positive factor and its interval, as precise as the interval allows: '5.1 × [4.4, 5.9]'."""
    centre, bounds = spread(value, low, high)
    return centre if centre == MISSING else f"{centre}{TIMES}{NBSP}{bounds}".rstrip(NBSP)


def spread(value: float, low: float, high: float) -> tuple[str, str]:
    """A positive value and its interval, '5.1' and '[4.4, 5.9]', to one digit of the half width.

    The value keeps two significant digits at the least and three at most. The interval is empty
    where unknown or unbounded.
    """
    if not math.isfinite(value) or value <= 0:
        return MISSING, ""
    if not (math.isfinite(low) and math.isfinite(high) and low > 0):
        return significant(value), ""
    magnitude = math.floor(math.log10(value))
    half = (high - low) / 2
    wanted = -math.floor(math.log10(half)) if half > 0 else 2 - magnitude
    decimals = min(max(wanted, 1 - magnitude), 2 - magnitude)
    shown = [number(round(bound, decimals), max(decimals, 0)) for bound in (value, low, high)]
    return shown[0], f"[{shown[1]},{NBSP}{shown[2]}]"


def count(value: float) -> str:
    """A whole number with thousands separated; a dash where it is not finite."""
    return number(round(value), 0) if math.isfinite(value) else MISSING


def duration(seconds: float) -> str:
    """Seconds in the unit a reader thinks in: '0.45 ms', '3.20 s', '12.5 min', '2.10 h'."""
    if not math.isfinite(seconds):
        return MISSING
    for limit, scale, unit in ((1e-3, 1e6, "µs"), (1.0, 1e3, "ms"), (120.0, 1.0, "s"), (7200.0, 1 / 60, "min")):
        if seconds < limit:
            return f"{significant(seconds * scale)}{NBSP}{unit}"
    return f"{significant(seconds / 3600.0)}{NBSP}h"


def words(items: list[str]) -> str:
    """A list in a sentence: 'a', 'a and b', 'a, b and c'."""
    return items[0] if len(items) == 1 else f"{', '.join(items[:-1])} and {items[-1]}" if items else ""


def span(numbers: list[int], noun: str) -> str:
    """How many of something: '8 replicas' where all agree, '8 to 64 replicas' where not."""
    low, high = min(numbers), max(numbers)
    return plural(high, noun) if low == high else f"{count(low)} to {plural(high, noun)}"


def plural(n: int, noun: str, nouns: str = "") -> str:
    """'1 pair', '3 pairs'."""
    return f"{count(n)}{NBSP}{noun if n == 1 else nouns or noun + 's'}"


def sentence(text: str) -> str:
    """Words from elsewhere as a sentence: a capital first, a full stop last."""
    text = text.strip()
    return text[:1].upper() + text[1:] + ("" if text.endswith((".", "!", "?")) else ".")


def typographic(text: str) -> str:
    """Plain text for print: true minus signs before digits, no line break between a number and its percent sign."""
    text = re.sub(r"(?<![\w-])-(?=\d)", MINUS, text)
    return re.sub(r"(?<=\d) (?=%)", NBSP, text)


def french(text: str) -> str:
    """Numbers in print as French has them: a decimal comma, thin spaces between thousands, semicolons in intervals."""
    text = re.sub(r",(?=[\s\N{NO-BREAK SPACE}]*[-+\N{MINUS SIGN}\d][\d.,]*\])", f"{NBSP};", text)
    text = re.sub(r"(?<=\d),(?=\d{3})", "\N{NARROW NO-BREAK SPACE}", text)
    return re.sub(r"(?<=\d)\.(?=\d)", ",", text)


_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
