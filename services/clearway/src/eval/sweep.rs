//! `--sweep KEY=A..B:N` and `--sweep KEY=a,b,c`: settings that take several values in turn.

use miette::{Result, miette};
use std::str::FromStr;

/// More combinations than this are a slip of the keyboard.
const COMBINATIONS_MAX: usize = 100_000;

/// One setting and the values that it takes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Sweep {
    key: String,
    /// As they are written in a configuration.
    values: Vec<String>,
}

/// One value for each key that is swept, in their order.
pub(super) type Point = Vec<(String, String)>;

const FORMS: &str =
    "controller.gamma=0.2..1.0:9 (nine values, both ends included) or controller.gamma=0.2,0.6,1.0";

impl FromStr for Sweep {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let wrong = |what: &str| format!("{what}; write {FORMS}");
        let (key, values) = text.split_once('=').ok_or_else(|| wrong("no `=`"))?;
        let key = key.trim();
        if key.starts_with("scenario") {
            return Err("scenarios are named as arguments and not swept".to_owned());
        }
        let values = if let Some((low, rest)) = values.split_once("..") {
            let (high, count) = rest.split_once(':').ok_or_else(|| wrong("how many values is missing"))?;
            let end = |text: &str| {
                let end = text.trim().parse().ok().filter(|x: &f64| x.is_finite());
                end.ok_or_else(|| wrong(&format!("`{}` is not a number", text.trim())))
            };
            let count: usize = count
                .trim()
                .parse()
                .ok()
                .filter(|n| (1..=COMBINATIONS_MAX).contains(n))
                .ok_or_else(|| wrong(&format!("`{}` is not a count of values", count.trim())))?;
            between(end(low)?, end(high)?, count)
        } else {
            values.split(',').map(|value| value.trim().to_owned()).collect()
        };
        if key.is_empty() || values.iter().any(String::is_empty) {
            return Err(wrong("a key or a value is missing"));
        }
        Ok(Self { key: key.to_owned(), values })
    }
}

/// `count` values at equal steps, both ends among them, without the noise of their last bits.
fn between(low: f64, high: f64, count: usize) -> Vec<String> {
    let last = count.saturating_sub(1).max(1) as f64;
    (0..count)
        .map(|k| {
            let x = low + (high - low) * (k as f64 / last);
            let short: f64 = format!("{x:.11e}").parse().unwrap_or(x);
            if short == 0.0 { "0".to_owned() } else { short.to_string() }
        })
        .collect()
}

/// Every combination of the values, the last key changing first; one empty point without sweeps.
pub(super) fn grid(sweeps: &[Sweep]) -> Result<Vec<Point>> {
    let again = |k: usize| sweeps[..k].iter().any(|earlier| earlier.key == sweeps[k].key);
    if let Some(k) = (0..sweeps.len()).find(|k| again(*k)) {
        let help = "give all of its values in one --sweep";
        return Err(miette!(help = help, "--sweep {} is given twice", sweeps[k].key));
    }
    let size = sweeps.iter().try_fold(1usize, |n, sweep| n.checked_mul(sweep.values.len()));
    if size.is_none_or(|n| n > COMBINATIONS_MAX) {
        let help = "sweep fewer keys or values";
        return Err(miette!(help = help, "more than {COMBINATIONS_MAX} combinations"));
    }
    let mut points: Vec<Point> = vec![Vec::new()];
    for sweep in sweeps {
        let longer = |point: &Point| {
            let point = point.clone();
            sweep.values.iter().map(move |value| {
                let mut point = point.clone();
                point.push((sweep.key.clone(), value.clone()));
                point
            })
        };
        points = points.iter().flat_map(longer).collect();
    }
    Ok(points)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn values(text: &str) -> Vec<String> {
        text.parse::<Sweep>().unwrap().values
    }

    #[test]
    fn ranges_and_lists_give_their_values() {
        assert_eq!(
            values("controller.gamma=0.2..1.0:9"),
            ["0.2", "0.3", "0.4", "0.5", "0.6", "0.7", "0.8", "0.9", "1"]
        );
        assert_eq!(values("timing.period_us=20000..80000:4"), ["20000", "40000", "60000", "80000"]);
        assert_eq!(values("a.b=-1..1:3"), ["-1", "0", "1"]);
        assert_eq!(values("a.b=1e-6..1:1"), ["0.000001"]);
        assert_eq!(values("controller.barrier=exact, linear"), ["exact", "linear"]);
    }

    #[test]
    fn a_slip_is_named_with_the_forms() {
        for (text, words) in [
            ("controller.gamma", "no `=`"),
            ("controller.gamma=0.2..1.0", "how many"),
            ("controller.gamma=0.2..x:3", "`x` is not a number"),
            ("controller.gamma=0.2..1:0", "`0` is not a count"),
            ("controller.gamma=0.2,,1", "missing"),
            ("=0.2", "missing"),
        ] {
            let error = text.parse::<Sweep>().unwrap_err();
            assert!(error.contains(words) && error.contains("0.2..1.0:9"), "{text}: {error}");
        }
        assert!("scenario=swap8,swap8-zero".parse::<Sweep>().is_err());
    }

    #[test]
    fn several_sweeps_make_a_grid() {
        let sweeps = ["a.x=1,2", "a.y=1,2,3"].map(|s| s.parse::<Sweep>().unwrap());
        let points = grid(&sweeps).unwrap();
        assert_eq!(points.len(), 6);
        assert_eq!(points[1], [("a.x".into(), "1".into()), ("a.y".into(), "2".into())]);
        assert_eq!(grid(&[]).unwrap(), [vec![]]);
        assert!(grid(&[sweeps[0].clone(), sweeps[0].clone()]).is_err());
        let large: Sweep = "a.z=0..1:100000".parse().unwrap();
        assert!(grid(&[sweeps[0].clone(), large]).is_err());
    }
}
