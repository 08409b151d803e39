//! A number with its 95 % interval, in the same words everywhere: sentences, tables, terminal. RT: no.

use super::findings::Estimate;
use super::table::number;

/// Opens the brackets behind a value where they say what they hold: once in a text, see [`say_once`].
const NAMED: &str = "[95 % interval ";
/// Opens the others.
const OPEN: &str = "[";
/// Ratio of the ends from which three digits of each say more than digits that their distance gives.
const WIDE: f64 = 2.0;
/// Sizes that are written without an exponent, and the narrowest interval of one that is.
const FIXED: std::ops::Range<f64> = 1e-4..1e5;
const FINEST: f64 = 1e-9;
/// Digits behind the point of a number that is written with an exponent, at least and at most.
const MANTISSA: [f64; 2] = [2.0, 9.0];

/// `value [95 % interval low to high] unit`; the value alone where no interval is known.
#[must_use]
pub fn with_interval(of: &Estimate) -> String {
    let [value, low, high] = digits(of, [of.value, of.low, of.high]);
    let interval = if is_known(of) { format!(" {NAMED}{low} to {high}]") } else { String::new() };
    with_unit(&(value + &interval), of.unit)
}

/// The value alone, with the digits that its interval leaves.
#[must_use]
pub fn value(of: &Estimate) -> String {
    let [value] = digits(of, [of.value]);
    value
}

/// The interval alone; empty where none is known.
#[must_use]
pub fn interval(of: &Estimate) -> String {
    let [low, high] = digits(of, [of.low, of.high]);
    if is_known(of) { format!("{low} to {high}") } else { String::new() }
}

/// Another value for the same number, with the same digits.
#[must_use]
pub fn beside(of: &Estimate, other: f64) -> String {
    let [other] = digits(of, [other]);
    other
}

/// `text unit`.
#[must_use]
pub fn with_unit(text: &str, unit: &str) -> String {
    if unit.is_empty() { text.to_owned() } else { format!("{text} {unit}") }
}

/// `text` that says at the first interval alone what it is.
#[must_use]
pub fn say_once(text: &str) -> String {
    match text.split_once(NAMED) {
        Some((head, tail)) => format!("{head}{NAMED}{}", tail.replace(NAMED, OPEN)),
        None => text.to_owned(),
    }
}

/// `text` as it stands where intervals were explained before.
#[must_use]
pub fn said_before(text: &str) -> String {
    text.replace(NAMED, OPEN)
}

fn is_known(of: &Estimate) -> bool {
    of.low.is_finite() && of.high.is_finite() && of.low < of.high
}

/// `values` with the digits that an interval leaves: all with as many, so that rounding keeps their order.
fn digits<const N: usize>(of: &Estimate, values: [f64; N]) -> [String; N] {
    let (half, size) = (0.5 * (of.high - of.low), of.low.abs().max(of.high.abs()));
    let is_wide = of.low * of.high > 0.0 && size > WIDE * of.low.abs().min(of.high.abs());
    if !is_known(of) || is_wide {
        return values.map(number);
    }
    if !FIXED.contains(&size) || half < FINEST {
        let [least, most] = MANTISSA;
        return values.map(|v| exponential(v, libm::floor(libm::log10(size / half) + 1.0).clamp(least, most)));
    }
    let decimals = (1.0 - libm::floor(libm::log10(half))).max(0.0);
    values.map(|v| fixed(v, decimals))
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to a few digits")]
fn exponential(value: f64, decimals: f64) -> String {
    if value == 0.0 { "0".to_owned() } else { format!("{value:.*e}", decimals as usize) }
}

/// What would be rounded to zero keeps its own digits.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "between 0 and 10")]
fn fixed(value: f64, decimals: f64) -> String {
    let text = format!("{value:.*}", decimals as usize);
    if text.contains(|c: char| ('1'..='9').contains(&c)) { text } else { number(value) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn estimate(value: f64, low: f64, high: f64) -> Estimate {
        Estimate { value, std: 0.0, low, high, unit: "Nm" }
    }

    #[test]
    fn the_interval_decides_the_digits_and_the_unit_stands_behind() {
        let told = with_interval(&estimate(0.203_448, 0.200_615, 0.206_281));
        assert_eq!(told, "0.2034 [95 % interval 0.2006 to 0.2063] Nm");
        assert_eq!(with_interval(&estimate(364.2, 258.1, 470.3)), "364 [95 % interval 258 to 470] Nm");
        assert_eq!(with_interval(&estimate(3.0, f64::NAN, f64::NAN)), "3 Nm");
        assert_eq!(with_interval(&estimate(3.0, 3.0, 3.0)), "3 Nm", "no interval, no brackets");
        assert_eq!(interval(&estimate(6e-5, 5.99e-5, 6.01e-5)), "5.990e-5 to 6.010e-5");
    }

    #[test]
    fn rounding_leaves_no_value_outside_its_own_interval() {
        let told = estimate(9.31e-5, 8.2e-5, 0.018);
        assert_eq!((value(&told), interval(&told)), ("9.31e-5".to_owned(), "8.20e-5 to 0.018".to_owned()));
        let sizes = [0.0, 3e-8, 9.31e-5, 1e-4, 0.019, 0.5, 7.77, 99.96, 123_456.0];
        let all = || sizes.iter().flat_map(|s| [-s, *s]);
        for (low, value, high) in all().flat_map(|a| all().flat_map(move |b| all().map(move |c| (a, b, c)))) {
            if low <= value && value <= high {
                let of = estimate(value, low, high);
                let read = |text: String| text.parse::<f64>().unwrap();
                let [value, low, high] = digits(&of, [of.value, of.low, of.high]).map(read);
                assert!(low <= value && value <= high, "{of:?}: {value} [{low} to {high}]");
            }
        }
    }

    #[test]
    fn a_text_says_once_what_the_brackets_hold() {
        let one = with_interval(&estimate(1.0, 0.9, 1.1));
        assert_eq!(say_once(&format!("{one}, {one}")).matches("95 %").count(), 1);
    }
}
