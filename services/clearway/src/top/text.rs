//! Numbers in few columns.

/// What stands where there is nothing to say.
pub(crate) const NOTHING: &str = "-";

/// A time with three digits: at most seven columns below 1000 s.
pub(crate) fn time(ns: u64, ascii: bool) -> String {
    let micro = if ascii { "us" } else { "µs" };
    let units = [(1_000_000_000_u32, "s"), (1_000_000, "ms"), (1_000, micro)];
    let Some((size, unit)) = units.into_iter().find(|(size, _)| ns >= u64::from(*size)) else {
        return format!("{ns} ns");
    };
    let value = ns as f64 / f64::from(size);
    let digits = if value < 9.995 { 2 } else { usize::from(value < 99.95) };
    format!("{value:.digits$} {unit}")
}

/// How long something has lasted, for a person.
pub(crate) fn lasted(ns: u64) -> String {
    let seconds = ns / 1_000_000_000;
    match seconds {
        0..60 => format!("{:.1} s", ns as f64 * 1e-9),
        60..3600 => format!("{} min {:02} s", seconds / 60, seconds % 60),
        3600..86_400 => format!("{} h {:02} min", seconds / 3600, seconds / 60 % 60),
        _ => format!("{} d {:02} h", seconds / 86_400, seconds / 3600 % 24),
    }
}

/// A number in at most `width` columns, with at most three decimals and as many as fit; small ones with
/// their exponent.
pub(crate) fn number(value: f64, width: usize) -> String {
    if !value.is_finite() {
        return NOTHING.to_owned();
    }
    // No negative zero.
    let value = if value == 0.0 { 0.0 } else { value };
    if value != 0.0 && value.abs() < 5e-4 {
        let short = format!("{value:.0e}");
        return if short.len() <= width { short } else { "0".to_owned() };
    }
    let fits = (0..=3).rev().map(|digits| format!("{value:.digits$}")).find(|text| text.len() <= width);
    fits.unwrap_or_else(|| format!("{value:.0e}"))
}

/// A number in at most `width` columns, where what is below a thousandth is nothing.
pub(crate) fn fixed(value: f64, width: usize) -> String {
    number(if value.abs() < 5e-4 { 0.0 } else { value }, width)
}

/// A count in at most six columns.
pub(crate) fn count(n: u64) -> String {
    let short = |size: f64, unit: &str| {
        let value = n as f64 / size;
        let digits = usize::from(value < 99.95);
        format!("{value:.digits$}{unit}")
    };
    match n {
        0..1_000_000 => n.to_string(),
        1_000_000..1_000_000_000 => short(1e6, "M"),
        1_000_000_000..1_000_000_000_000 => short(1e9, "G"),
        _ => short(1e12, "T"),
    }
}

/// How many columns a text takes: everything that is shown here is one column a character.
pub(crate) fn columns(text: &str) -> usize {
    text.chars().count()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_keep_three_digits_in_seven_columns() {
        for (ns, text) in [
            (0, "0 ns"),
            (999, "999 ns"),
            (1_000, "1.00 µs"),
            (12_345, "12.3 µs"),
            (999_949, "1000 µs"),
            (4_560_000, "4.56 ms"),
            (80_000_000, "80.0 ms"),
            (10_000_000_000, "10.0 s"),
        ] {
            assert_eq!(time(ns, false), text);
            assert!(columns(text) <= 7);
        }
        assert_eq!(time(12_345, true), "12.3 us");
        assert_eq!(lasted(1_250_000_000), "1.2 s");
        assert_eq!(lasted(3_725_000_000_000), "1 h 02 min");
        assert_eq!(lasted(200_000_000_000_000), "2 d 07 h");
    }

    #[test]
    fn numbers_and_counts_fit() {
        for (value, width, text) in [
            (-12.345_6, 6, "-12.35"),
            (0.0, 5, "0.000"),
            (-0.0, 5, "0.000"),
            (1234.5, 5, "1234"),
            (0.000_012, 7, "1e-5"),
            (f64::INFINITY, 5, "-"),
            (f64::NAN, 5, "-"),
            (1e12, 6, "1e12"),
        ] {
            assert_eq!(number(value, width), text);
        }
        assert_eq!((count(999_999), count(1_234_567)), ("999999".to_owned(), "1.2M".to_owned()));
        assert!(columns(&count(u64::MAX)) <= 9);
    }
}
