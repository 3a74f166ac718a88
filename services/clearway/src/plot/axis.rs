//! Axes: what is measured, in which unit, over which range, with which ticks.

/// One axis of a panel.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Axis {
    label: String,
    log: bool,
    low: Option<f64>,
    high: Option<f64>,
}

impl Axis {
    /// A linear axis for `quantity` in `unit`; an empty unit where there is none.
    pub(crate) fn linear(quantity: &str, unit: &str) -> Self {
        let label = if unit.is_empty() { quantity.to_owned() } else { format!("{quantity} [{unit}]") };
        Self { label, log: false, low: None, high: None }
    }

    /// A logarithmic axis; what is not above zero has no place on it.
    pub(crate) fn log(quantity: &str, unit: &str) -> Self {
        Self { log: true, ..Self::linear(quantity, unit) }
    }

    /// Begins at `low` whatever is drawn.
    pub(crate) fn from(self, low: f64) -> Self {
        Self { low: Some(low), ..self }
    }

    /// Ends at `high` whatever is drawn.
    pub(crate) fn to(self, high: f64) -> Self {
        Self { high: Some(high), ..self }
    }

    pub(super) fn label(&self) -> &str {
        &self.label
    }

    /// Where a value stands: itself, or its logarithm; `None` where it has no place.
    pub(super) fn place(&self, value: f64) -> Option<f64> {
        let at = if self.log { value.log10() } else { value };
        at.is_finite().then_some(at)
    }

    /// The range as places, from the places of everything that is drawn; `pad` of it is left free
    /// at an end that was not given.
    pub(super) fn span(&self, places: impl Iterator<Item = f64>, pad: f64) -> (f64, f64) {
        let (low, high) =
            places.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)));
        let given = |end: Option<f64>| end.and_then(|end| self.place(end));
        let (mut low, mut high) = if low <= high { (low, high) } else { (0.0, 1.0) };
        let (fixed_low, fixed_high) = (given(self.low), given(self.high));
        low = fixed_low.unwrap_or(low);
        high = fixed_high.unwrap_or(high);
        if high - low < 1e-9 * high.abs().max(1.0) {
            (low, high) = (low - 0.5, high + 0.5);
        }
        let room = pad * (high - low);
        (
            if fixed_low.is_some() { low } else { low - room },
            if fixed_high.is_some() { high } else { high + room },
        )
    }

    /// Ticks with a label, and the finer lines between them, as places inside `span`.
    pub(super) fn ticks(&self, span: (f64, f64), wanted: usize) -> Ticks {
        if self.log && span.1 - span.0 > 0.8 { decades(span, wanted) } else { self.steps(span, wanted) }
    }

    /// Multiples of 1, 2 or 5 times a power of ten.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // small, by the step chosen
    fn steps(&self, span: (f64, f64), wanted: usize) -> Ticks {
        // On less than a decade of a logarithmic axis the values are stepped, not the logarithms.
        let value = |at: f64| if self.log { 10f64.powf(at) } else { at };
        let (low, high) = (value(span.0), value(span.1));
        let rough = (high - low) / wanted.max(1) as f64;
        let power = 10f64.powf(rough.log10().floor());
        let step = [1.0, 2.0, 5.0, 10.0].into_iter().map(|m| m * power).find(|s| *s >= rough * 0.999);
        let step = step.unwrap_or(10.0 * power);
        let digits = (-step.log10().floor()).max(0.0) as usize;
        let slack = 1e-9 * (high - low);
        let first = ((low - slack) / step).ceil() as i64;
        let last = ((high + slack) / step).floor() as i64;
        let labelled = (first..=last)
            .filter_map(|k| {
                let x = k as f64 * step;
                Some((self.place(x)?, number(x, digits)))
            })
            .collect();
        Ticks { labelled, fine: Vec::new() }
    }
}

/// Where the lines of the grid stand.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Ticks {
    pub(super) labelled: Vec<(f64, String)>,
    pub(super) fine: Vec<f64>,
}

/// Powers of ten, with the lines for 2 to 9 between them where there is room.
#[allow(clippy::cast_possible_truncation)] // exponents of doubles
fn decades(span: (f64, f64), wanted: usize) -> Ticks {
    let (first, last) = (span.0.floor() as i32, span.1.ceil() as i32);
    let every = usize::try_from(last - first).unwrap_or(0).div_ceil(wanted.max(1)).max(1);
    let inside = |at: f64| (span.0 - 1e-9..=span.1 + 1e-9).contains(&at);
    let mut ticks = Ticks { labelled: Vec::new(), fine: Vec::new() };
    for power in first..=last {
        if inside(f64::from(power)) {
            if power.rem_euclid(i32::try_from(every).unwrap_or(1)) == 0 {
                ticks.labelled.push((f64::from(power), power_of_ten(power)));
            } else {
                ticks.fine.push(f64::from(power));
            }
        }
        if every == 1 {
            let between = (2..10).map(|m| f64::from(power) + f64::from(m).log10());
            ticks.fine.extend(between.filter(|at| inside(*at)));
        }
    }
    ticks
}

fn power_of_ten(power: i32) -> String {
    if (-3..=4).contains(&power) {
        let digits = usize::try_from(-power).unwrap_or(0);
        return number(10f64.powi(power), digits);
    }
    let raised = |c: char| match c {
        '-' => '⁻',
        '1' => '¹',
        '2' => '²',
        '3' => '³',
        c => char::from_u32(c as u32 - '0' as u32 + '⁰' as u32).unwrap_or(c),
    };
    format!("10{}", power.to_string().chars().map(raised).collect::<String>())
}

/// A number with a real minus sign, and none on zero.
fn number(x: f64, digits: usize) -> String {
    let text = format!("{x:.digits$}");
    if text.chars().all(|c| matches!(c, '-' | '0' | '.')) {
        return text.trim_start_matches('-').to_owned();
    }
    text.replace('-', "−")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn labels(axis: &Axis, span: (f64, f64), wanted: usize) -> Vec<String> {
        axis.ticks(span, wanted).labelled.into_iter().map(|(_, text)| text).collect()
    }

    #[test]
    fn linear_ticks_are_round() {
        let axis = Axis::linear("x", "m");
        assert_eq!(axis.label(), "x [m]");
        assert_eq!(labels(&axis, (-5.3, 5.3), 6), ["−4", "−2", "0", "2", "4"]);
        assert_eq!(labels(&axis, (0.0, 0.25), 5), ["0.00", "0.05", "0.10", "0.15", "0.20", "0.25"]);
        assert_eq!(labels(&axis, (-0.1, 0.3), 4), ["−0.1", "0.0", "0.1", "0.2", "0.3"]);
    }

    #[test]
    fn logarithmic_ticks_are_powers_and_lack_nothing_below_one_decade() {
        let axis = Axis::log("time", "ns");
        let span = (axis.place(10.0).unwrap(), axis.place(1e6).unwrap());
        assert_eq!(labels(&axis, span, 8), ["10", "100", "1000", "10000", "10⁵", "10⁶"]);
        assert_eq!(labels(&axis, (-6.0, -4.0), 8), ["10⁻⁶", "10⁻⁵", "10⁻⁴"]);
        assert_eq!(labels(&axis, (2f64.log10(), 8.5f64.log10()), 5), ["2", "4", "6", "8"]);
        assert_eq!(axis.ticks((0.0, 1.0), 5).fine.len(), 8);
        assert_eq!(axis.place(0.0), None);
    }

    #[test]
    fn a_range_covers_what_is_drawn_and_what_was_asked_for() {
        let axis = Axis::linear("x", "").from(0.0);
        assert_eq!(axis.span([1.0, 3.0].into_iter(), 0.0), (0.0, 3.0));
        assert_eq!(axis.span([].into_iter(), 0.0), (0.0, 1.0));
        let (low, high) = Axis::linear("x", "").span([2.0].into_iter(), 0.05);
        assert!(low < 2.0 && high > 2.0);
    }
}
