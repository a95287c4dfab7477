//! Axes: labels, the mapping from values to positions on paper, and ticks.

/// An axis or a colour bar.
///
/// In labels and units, a caret before an integer makes it an exponent, as in `m/s^2`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Axis {
    /// Quantity, for example "Range".
    pub label: String,
    /// Unit, for example "m"; empty for none.
    pub unit: String,
    /// Values at the two ends; the first may be the larger one. The ends are taken from the data if this is `None`, or
    /// if they are equal, not finite or, on a logarithmic axis, not positive.
    pub limits: Option<[f64; 2]>,
    /// Mapping from values to positions.
    pub scale: AxisScale,
}

/// Mapping from values to positions on an axis.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum AxisScale {
    /// Linear.
    #[default]
    Linear,
    /// Decimal logarithm; values that are not positive have no position.
    Log10,
    /// sign(v) log10(1 + |v|): linear near zero, logarithmic far from it.
    SignedLog,
}

impl Axis {
    /// A linear axis whose ends are taken from the data.
    pub fn new(label: impl Into<String>, unit: impl Into<String>) -> Self {
        Self {
            label: label.into(),
            unit: unit.into(),
            ..Self::default()
        }
    }

    /// The same axis with the given ends.
    pub fn with_limits(self, first: f64, last: f64) -> Self {
        Self {
            limits: Some([first, last]),
            ..self
        }
    }

    /// The same axis with another mapping.
    pub fn with_scale(self, scale: AxisScale) -> Self {
        Self { scale, ..self }
    }

    /// The same axis for `n` cells of equal size, of which the first is centred at `first` and neighbours are `step`
    /// apart. The ends are the outer edges of the first and the last cell.
    pub fn with_cells(self, first: f64, step: f64, n: usize) -> Self {
        self.with_limits(first - 0.5 * step, first + (n as f64 - 0.5) * step)
    }

    /// Label and unit as printed at the axis, with the power of ten by which the numbers were divided.
    pub(super) fn title(&self, exponent: i32) -> String {
        let unit = match (exponent, self.unit.as_str()) {
            (0, "") => return self.label.clone(),
            (0, unit) => unit.to_owned(),
            (e, unit) => format!("10^{e} {unit}").trim_end().to_owned(),
        };
        format!("{} ({unit})", self.label).trim_start().to_owned()
    }
}

/// A tick with its number.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Tick {
    pub value: f64,
    pub text: String,
}

/// Mapping from the values of an axis to positions on paper.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Scale {
    kind: AxisScale,
    /// Transformed values at the two ends.
    first: f64,
    last: f64,
    /// Positions of the two ends, pt.
    from_pt: f64,
    to_pt: f64,
}

/// Maximum magnitude of an end of an axis, so that differences remain finite.
const LARGEST: f64 = 1e300;

/// Values are clamped to this many axis lengths beyond the ends, because viewers compute in single precision.
const FARTHEST: f64 = 1e3;

impl Scale {
    /// The scale of an axis for its data, from 0 to 1 pt. Ends that are taken from the data are moved outwards by the
    /// fraction `padding` of their distance.
    pub(super) fn new(axis: &Axis, data: impl IntoIterator<Item = f64>, padding: f64) -> Self {
        let kind = axis.scale;
        let given = axis.limits.map(|ends| ends.map(|v| transform(kind, v)));
        let [first, last] = match given {
            Some([a, b]) if a.is_finite() && b.is_finite() && a != b => [a, b].map(clamp),
            _ => around(data.into_iter().map(|v| transform(kind, v)), kind, padding),
        };
        Self {
            kind,
            first,
            last,
            from_pt: 0.0,
            to_pt: 1.0,
        }
    }

    /// The same scale between other positions, pt.
    pub(super) fn between(self, from_pt: f64, to_pt: f64) -> Self {
        Self {
            from_pt,
            to_pt,
            ..self
        }
    }

    /// Position of a value, pt; NaN for values without a position.
    pub(super) fn to_pt(&self, value: f64) -> f64 {
        self.from_pt + self.fraction(value) * (self.to_pt - self.from_pt)
    }

    /// Relative position of a value, 0 at the first end and 1 at the last, clamped to [`FARTHEST`] beyond them; NaN for
    /// values without a position.
    pub(super) fn fraction(&self, value: f64) -> f64 {
        let value = transform(self.kind, value);
        if !value.is_finite() {
            return f64::NAN;
        }
        let fraction = (clamp(value) - self.first) / (self.last - self.first);
        fraction.clamp(-FARTHEST, FARTHEST)
    }

    /// Value at a position: the inverse of [`Scale::to_pt`].
    pub(super) fn to_value(&self, place_pt: f64) -> f64 {
        let fraction = (place_pt - self.from_pt) / (self.to_pt - self.from_pt);
        inverse(self.kind, self.first + fraction * (self.last - self.first))
    }

    /// Values at the two ends.
    pub(super) fn ends(&self) -> [f64; 2] {
        [self.first, self.last].map(|v| inverse(self.kind, v))
    }

    /// Distance between the values at the ends of a linear axis.
    pub(super) fn extent(&self) -> f64 {
        (self.last - self.first).abs()
    }

    /// A linear scale with the same centre and another extent.
    pub(super) fn with_extent(self, extent: f64) -> Self {
        let middle = 0.5 * (self.first + self.last);
        let half = 0.5 * extent * (self.last - self.first).signum();
        Self {
            first: middle - half,
            last: middle + half,
            ..self
        }
    }

    /// About `max_n` ticks at most, and the power of ten by which their numbers were divided.
    pub(super) fn ticks(&self, max_n: usize) -> (Vec<Tick>, i32) {
        let max_n = max_n.clamp(2, 12);
        match self.kind {
            AxisScale::Linear => linear_ticks(self.first, self.last, max_n),
            AxisScale::Log10 => self.log_ticks(max_n),
            AxisScale::SignedLog => (self.signed_log_ticks(max_n), 0),
        }
    }

    /// Ticks at whole decades, or at round numbers if there are fewer than two decades.
    fn log_ticks(&self, max_n: usize) -> (Vec<Tick>, i32) {
        let (low, high) = (self.first.min(self.last), self.first.max(self.last));
        let step = ((high - low) / (max_n + 1) as f64).ceil().max(1.0);
        let first = (low / step - 1e-9).ceil() * step;
        let decades = counted(first, step, high + 1e-9, max_n + 2);
        if decades.len() < 2 {
            let [first, last] = self.ends();
            return linear_ticks(first, last, max_n);
        }
        let is_plain = decades.iter().all(|d| d.abs() <= 3.0);
        let ticks = decades.into_iter().map(|decade| {
            let value = 10_f64.powf(decade);
            let text = if is_plain {
                number(value, (-decade).max(0.0) as usize)
            } else {
                power_of_ten(decade)
            };
            Tick { value, text }
        });
        (ticks.collect(), 0)
    }

    /// Ticks at zero and at whole decades on both sides.
    fn signed_log_ticks(&self, max_n: usize) -> Vec<Tick> {
        let (low, high) = (self.first.min(self.last), self.first.max(self.last));
        let n_decades = high.max(0.0) + (-low).max(0.0);
        let step = (n_decades / max_n as f64).ceil().max(1.0);
        let reach = low.abs().max(high.abs());
        let mut ticks = Vec::new();
        for decade in counted(step, step, reach, 2 * max_n) {
            for sign in [-1.0, 1.0] {
                let minus = if sign < 0.0 { "\u{2212}" } else { "" };
                ticks.push(Tick {
                    value: sign * 10_f64.powf(decade),
                    text: format!("{minus}{}", power_of_ten(decade)),
                });
            }
        }
        ticks.push(Tick {
            value: 0.0,
            text: "0".into(),
        });
        ticks.retain(|t| (-1e-9..=1.0 + 1e-9).contains(&self.fraction(t.value)));
        ticks.sort_by(|a, b| a.value.total_cmp(&b.value));
        ticks
    }
}

fn clamp(value: f64) -> f64 {
    value.clamp(-LARGEST, LARGEST)
}

fn transform(kind: AxisScale, value: f64) -> f64 {
    match kind {
        AxisScale::Linear => value,
        AxisScale::Log10 if value > 0.0 => value.log10(),
        AxisScale::Log10 => f64::NAN,
        AxisScale::SignedLog => value.signum() * (1.0 + value.abs()).log10(),
    }
}

fn inverse(kind: AxisScale, value: f64) -> f64 {
    match kind {
        AxisScale::Linear => value,
        AxisScale::Log10 => 10_f64.powf(value),
        AxisScale::SignedLog => value.signum() * (10_f64.powf(value.abs()) - 1.0),
    }
}

/// Distinct ends that enclose all finite values, even if these are all equal or there are none.
fn around(values: impl Iterator<Item = f64>, kind: AxisScale, padding: f64) -> [f64; 2] {
    let (mut first, mut last) = (f64::INFINITY, f64::NEG_INFINITY);
    for v in values.filter(|v| v.is_finite()).map(clamp) {
        first = first.min(v);
        last = last.max(v);
    }
    if first > last {
        return [0.0, 1.0];
    }
    let magnitude = first.abs().max(last.abs());
    if last - first <= 1e-9 * magnitude {
        let half = match kind {
            AxisScale::Linear if magnitude > 0.0 => 0.5 * magnitude,
            _ => 0.5,
        };
        (first, last) = (first - half, last + half);
    }
    let padding = padding * (last - first);
    [first - padding, last + padding].map(clamp)
}

/// The values `first`, `first + step`, ... up to `last`, at most `max_n`.
fn counted(first: f64, step: f64, last: f64, max_n: usize) -> Vec<f64> {
    let values = (0..max_n).map(|i| first + i as f64 * step);
    values.take_while(|v| *v <= last).collect()
}

/// At least two and about `max_n` ticks at most, at multiples of 1, 2 or 5 times a power of ten.
fn linear_ticks(first: f64, last: f64, max_n: usize) -> (Vec<Tick>, i32) {
    let steps = (max_n..=max_n + 3).map(|n| ticks_in_steps(first, last, n));
    let mut enough = steps.skip_while(|(ticks, _)| ticks.len() < 2);
    enough.next().unwrap_or_default()
}

/// Ticks at multiples of a round step of at least the `n`th part of the axis. Numbers of 100,000 and more, or below
/// 0.001, are divided by a power of 1000.
fn ticks_in_steps(first: f64, last: f64, n: usize) -> (Vec<Tick>, i32) {
    let (low, high) = (first.min(last), first.max(last));
    let rough = (high - low) / n as f64;
    if !(rough.is_finite() && rough >= 1e-290) {
        return (Vec::new(), 0);
    }
    let decade = rough.log10().floor();
    let unit = 10_f64.powf(decade);
    let factor = [1.0, 2.0, 5.0]
        .into_iter()
        .find(|f| f * unit >= rough * 0.999);
    let (factor, decade) = factor.map_or((1.0, decade + 1.0), |f| (f, decade));
    let step = factor * 10_f64.powf(decade);
    let magnitude = low.abs().max(high.abs());
    let exponent = match magnitude {
        m if (1e-3..1e5).contains(&m) => 0,
        m => 3 * (m.log10() / 3.0 + 1e-9).floor() as i32,
    };
    let decimals = (f64::from(exponent) - decade).clamp(0.0, 15.0) as usize;
    let n_first = (low / step - 1e-6).ceil();
    let ticks = counted(n_first, 1.0, high / step + 1e-6, n + 2).into_iter();
    let ticks = ticks.map(|n| Tick {
        value: n * step,
        // The factors are applied one after the other, because 10^-exponent alone may be infinite.
        text: number(
            n * factor * 10_f64.powf(decade - f64::from(exponent)),
            decimals,
        ),
    });
    (ticks.collect(), exponent)
}

/// Formats a number with fixed decimals and a typographic minus sign.
pub(super) fn number(value: f64, decimals: usize) -> String {
    let text = format!("{value:.decimals$}");
    match text.strip_prefix('-') {
        Some(digits) if digits.chars().all(|c| c == '0' || c == '.') => digits.into(),
        Some(digits) => format!("\u{2212}{digits}"),
        None => text,
    }
}

fn power_of_ten(decade: f64) -> String {
    format!("10^{decade:.0}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn ticks(first: f64, last: f64, n: usize) -> (Vec<String>, i32) {
        let scale = Scale::new(&Axis::default().with_limits(first, last), [], 0.0);
        let (ticks, exponent) = scale.ticks(n);
        (ticks.into_iter().map(|t| t.text).collect(), exponent)
    }

    #[test]
    fn linear_ticks_are_round_and_inside() {
        assert_eq!(ticks(0.0, 10.0, 5).0, ["0", "2", "4", "6", "8", "10"]);
        let around_zero = ["\u{2212}4", "\u{2212}2", "0", "2", "4"];
        assert_eq!(ticks(-4.386, 4.317, 5).0, around_zero);
        assert_eq!(
            ticks(0.3, 0.5, 4).0,
            ["0.30", "0.35", "0.40", "0.45", "0.50"]
        );
        // A descending axis has the same ticks.
        assert_eq!(ticks(10.0, 0.0, 5).0.len(), 6);
        // Long numbers are divided by a power of ten.
        let expected = ["0", "20", "40", "60", "80", "100"].map(String::from);
        assert_eq!(ticks(0.0, 1e8, 5), (expected.to_vec(), 6));
        assert_eq!(ticks(0.0, 4e-6, 4).1, -6);
    }

    #[test]
    fn logarithmic_ticks_are_decades() {
        let axis = Axis::default().with_scale(AxisScale::Log10);
        let texts = |first, last, n| {
            let scale = Scale::new(&axis.clone().with_limits(first, last), [], 0.0);
            let (ticks, _) = scale.ticks(n);
            ticks.into_iter().map(|t| t.text).collect::<Vec<_>>()
        };
        assert_eq!(texts(0.01, 100.0, 6), ["0.01", "0.1", "1", "10", "100"]);
        assert_eq!(texts(1e-6, 1.0, 4), ["10^-6", "10^-4", "10^-2", "10^0"]);
        // Less than a decade gives round numbers.
        assert_eq!(texts(20.0, 60.0, 4), ["20", "30", "40", "50", "60"]);
    }

    #[test]
    fn signed_logarithmic_ticks_have_zero_in_the_middle() {
        let axis = Axis::default().with_scale(AxisScale::SignedLog);
        let scale = Scale::new(&axis.with_limits(-32768.0, 32767.0), [], 0.0);
        let texts: Vec<String> = scale.ticks(6).0.into_iter().map(|t| t.text).collect();
        assert_eq!(texts, ["\u{2212}10^4", "\u{2212}10^2", "0", "10^2", "10^4"]);
        assert!((scale.fraction(0.0) - 0.5).abs() < 1e-4);
    }

    #[test]
    fn ends_are_apart_whatever_the_data() {
        for data in [
            &[][..],
            &[f64::NAN],
            &[0.0],
            &[3.0, 3.0],
            &[-1e300, 1e300],
            &[f64::MAX, f64::MIN],
            &[1e-320, 2e-320],
            &[1e9, 1e9 + 1e-3],
        ] {
            for scale in [AxisScale::Linear, AxisScale::Log10, AxisScale::SignedLog] {
                for limits in [None, Some([1.0, 1.0]), Some([f64::NAN, 2.0])] {
                    let axis = Axis {
                        limits,
                        scale,
                        ..Axis::default()
                    };
                    let scale = Scale::new(&axis, data.iter().copied(), 0.05);
                    assert!(
                        scale.extent() > 0.0 && scale.extent().is_finite(),
                        "{data:?}"
                    );
                    let (ticks, _) = scale.ticks(5);
                    assert!(ticks.len() <= 12, "{data:?}: {ticks:?}");
                    for tick in ticks {
                        let at = scale.fraction(tick.value);
                        assert!((-1e-5..1.00001).contains(&at), "{data:?}: {tick:?} at {at}");
                    }
                }
            }
        }
    }

    #[test]
    fn units_are_written_with_the_power_of_ten() {
        let axis = Axis::new("Power", "W");
        assert_eq!(axis.title(0), "Power (W)");
        assert_eq!(axis.title(-12), "Power (10^-12 W)");
        assert_eq!(Axis::new("Count", "").title(3), "Count (10^3)");
        assert_eq!(Axis::new("", "dB").title(0), "(dB)");
        assert_eq!(Axis::new("Count", "").title(0), "Count");
    }

    proptest! {
        #[test]
        fn places_and_values_are_inverse(
            first in -1e6_f64..1e6,
            extent in 1e-3_f64..1e6,
            fraction in 0.0_f64..1.0,
            falls: bool,
            kind in 0..3_usize,
        ) {
            let kind = [AxisScale::Linear, AxisScale::Log10, AxisScale::SignedLog][kind];
            let first = if kind == AxisScale::Log10 { first.abs() + 1e-3 } else { first };
            let ends = [first, first + extent];
            let [a, b] = if falls { [ends[1], ends[0]] } else { ends };
            let axis = Axis::default().with_limits(a, b).with_scale(kind);
            let scale = Scale::new(&axis, [], 0.0).between(200.0, 20.0);
            let value = ends[0] + fraction * extent;
            let place = scale.to_pt(value);
            prop_assert!((19.999..200.001).contains(&place));
            // The rounding of a value near `first` limits the accuracy of the inverse.
            let tolerance = 1e-7 * extent + 1e-9 * value.abs();
            prop_assert!((scale.to_value(place) - value).abs() < tolerance);
        }

        #[test]
        fn ticks_stand_where_their_numbers_say(first in -1e4_f64..1e4, extent in 1e-2_f64..1e4, n in 2..10_usize) {
            let axis = Axis::default().with_limits(first, first + extent);
            let scale = Scale::new(&axis, [], 0.0);
            let (ticks, exponent) = scale.ticks(n);
            prop_assert!((2..=n + 3).contains(&ticks.len()));
            for tick in &ticks {
                let shown: f64 = tick.text.replace('\u{2212}', "-").parse().unwrap();
                let shown = shown * 10_f64.powi(exponent);
                prop_assert!((shown - tick.value).abs() <= 1e-6 * extent);
                prop_assert!((-1e-5..=1.00001).contains(&scale.fraction(tick.value)));
            }
            let mut texts: Vec<_> = ticks.iter().map(|t| &t.text).collect();
            texts.dedup();
            prop_assert_eq!(texts.len(), ticks.len());
        }
    }
}
