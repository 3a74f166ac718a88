//! What is drawn over time: inputs, distances, clearances, Lyapunov values.

use super::cases::Case;
use super::{LAWS, columns, law_name};
use crate::plot::{Axis, Colour, Dash, Figure, Panel, Style};
use clearway::certificate::{Decrease, FiniteTime};
use clearway::config::Profile;
use clearway::controller::Timing;
use clearway::evaluation::{Period, Sample, Trace};

/// The share of the runs above and below a band.
const TAIL: f64 = 0.1;

/// What a run shows in a period.
type Value = dyn Fn(&Period) -> f64;

/// A run's value in period `k`; what it ended with is kept.
fn at(run: &Trace, k: usize, value: &Value) -> Option<f64> {
    run.periods.get(k).or(run.periods.last()).map(value)
}

/// A panel that begins at t = 0 and ends when the case does.
fn over_time(case: &Case, y: Axis) -> Panel {
    Panel::new(Axis::linear("time", "s").from(0.0).to(case.end_s()), y)
}

/// Periods until the end of a case, the one that begins there among them.
fn periods(case: &Case) -> usize {
    LAWS.iter()
        .flat_map(|law| case.under(*law))
        .map(|run| {
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // a few thousand
            let end = (case.end_s() / run.period_s).ceil() as usize;
            end + 1
        })
        .max()
        .unwrap_or(1)
}

/// Adds the lines of all laws: `over` of all runs, and where there are several runs the band that holds
/// all but a tenth above and a tenth below, where `banded`.
fn lines(panel: &mut Panel, case: &Case, value: &Value, over: fn(&mut [f64]) -> f64, banded: bool) {
    let mut bands = Vec::new();
    for law in LAWS {
        let runs = case.under(law);
        let period_s = runs[0].period_s;
        let (mut line, mut low, mut high) = (Vec::new(), Vec::new(), Vec::new());
        for k in 0..periods(case) {
            let mut values: Vec<f64> = runs.iter().filter_map(|run| at(run, k, value)).collect();
            values.sort_by(f64::total_cmp);
            let t = k as f64 * period_s;
            low.push((t, quantile(&values, TAIL)));
            high.push((t, quantile(&values, 1.0 - TAIL)));
            line.push((t, over(&mut values)));
        }
        if banded && runs.len() > 1 {
            bands.push((low, high, Style::of(law).colour));
        }
        panel.line(law_name(law), line, Style::of(law));
    }
    for (low, high, colour) in bands {
        panel.band("80 % of the runs", low, high, colour);
    }
}

/// Of sorted values.
fn quantile(values: &[f64], share: f64) -> f64 {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // an index
    let k = ((values.len().saturating_sub(1)) as f64 * share).round() as usize;
    values.get(k).copied().unwrap_or(f64::NAN)
}

fn mean(values: &mut [f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

fn least(values: &mut [f64]) -> f64 {
    values.iter().copied().fold(f64::INFINITY, f64::min)
}

fn largest(values: &mut [f64]) -> f64 {
    values.iter().copied().fold(f64::NEG_INFINITY, f64::max)
}

/// The mean over the robots of a period.
fn robots(period: &Period, value: impl Fn(&Sample) -> f64) -> f64 {
    period.fleet.iter().map(value).sum::<f64>() / period.fleet.len().max(1) as f64
}

/// Fig. 3: average inputs.
pub(super) fn inputs(cases: &[Case]) -> Figure {
    let rows: [(&str, &str, &Value); 3] = [
        ("mean v", "m/s", &|p| robots(p, |r| r.input.v_mps)),
        ("mean ω", "rad/s", &|p| robots(p, |r| r.input.omega_radps)),
        ("mean |ω|", "rad/s", &|p| robots(p, |r| r.input.omega_radps.abs())),
    ];
    let mut figure = columns("Average inputs over time, under each control law", cases).panel_height(220.0);
    for (row, (quantity, unit, value)) in rows.into_iter().enumerate() {
        for case in cases {
            let mut panel = over_time(case, Axis::linear(quantity, unit));
            if row == 0 {
                panel = panel.titled(&case.title);
            }
            lines(&mut panel, case, value, mean, true);
            figure = figure.with(panel);
        }
    }
    figure
}

/// Fig. 4: average distance to the goal, and the same with a logarithmic axis.
pub(super) fn distance(cases: &[Case]) -> Figure {
    let title = "Average distance to the goal over time, under each control law";
    let mut figure = columns(title, cases).panel_height(250.0);
    for log in [false, true] {
        for case in cases {
            let quantity = "mean distance to goal";
            let axis = if log { Axis::log(quantity, "m") } else { Axis::linear(quantity, "m").from(0.0) };
            let mut panel = over_time(case, axis);
            if !log {
                panel = panel.titled(&case.title);
            }
            lines(&mut panel, case, &|p| robots(p, |r| r.distance_m), mean, true);
            if log {
                panel.level(case.config.scenario.tolerance_m, "tolerance");
            }
            figure = figure.with(panel);
        }
    }
    figure
}

/// The smallest clearance of any pair in each period.
pub(super) fn clearance(cases: &[Case]) -> Figure {
    let title = "Smallest distance of any pair beyond the required one, over continuous time";
    let mut figure = columns(title, cases).panel_height(290.0);
    for case in cases {
        let mut panel = over_time(case, Axis::linear("smallest clearance", "m").to(1.6)).titled(&case.title);
        // Nobody to keep clear of: nothing to draw.
        let shown = |p: &Period| if p.min_clearance_m.is_finite() { p.min_clearance_m } else { f64::NAN };
        lines(&mut panel, case, &shown, least, false);
        panel.level(0.0, "required");
        figure = figure.with(panel);
    }
    figure
}

/// The largest Lyapunov value of any robot against what finite time promises.
pub(super) fn lyapunov(cases: &[Case], timing: Timing) -> Figure {
    let title = "Largest Lyapunov value of any robot over time, and the finite-time bounds";
    let mut figure = columns(title, cases).panel_height(320.0);
    for case in cases {
        let tolerance_m = case.config.scenario.tolerance_m;
        let floor = 0.5 * tolerance_m * tolerance_m;
        let axis = Axis::log("largest V = ½d²", "m²").from(floor / 5.0);
        let mut panel = over_time(case, axis).titled(&case.title);
        let worst = |p: &Period| largest(&mut p.fleet.iter().map(Sample::lyapunov_m2).collect::<Vec<_>>());
        lines(&mut panel, case, &worst, largest, false);

        let run = &case.under(Profile::Certified)[0];
        let start_m2 = run.periods.first().map_or(0.0, worst);
        let control = &case.config.controller;
        let law = FiniteTime { c3: control.c3, alpha: control.alpha };
        let reach_m = case.config.scenario.limits.speed_mps() * run.period_s;
        // What is decided on the state of t_0 acts one period later in the daemon.
        let delay_s = if timing == Timing::Ideal { 0.0 } else { run.period_s };
        let style = Style { dash: Dash::Dashed, ..Style::solid(Colour::INK).wide(1.1) };
        for (name, decrease, style) in [
            ("recursion z − Q_sat(z)", Decrease::FiniteTime { law, alignment: control.alignment }, style),
            ("recursion z − Q(z), printed", Decrease::Printed(law), Style { dash: Dash::Dotted, ..style }),
        ] {
            panel.line(name, recursion(&decrease, start_m2, reach_m, floor, delay_s, run.period_s), style);
        }
        if let Some(steps) = law.settling_bound(start_m2) {
            panel.moment(delay_s + steps as f64 * run.period_s, "bound (14)");
        }
        panel.level(floor, "tolerance");
        figure = figure.with(panel);
    }
    figure
}

/// The scalar recursion from `start_m2` until it is below `floor_m2`.
fn recursion(
    decrease: &Decrease,
    start_m2: f64,
    reach_m: f64,
    floor_m2: f64,
    delay_s: f64,
    period_s: f64,
) -> Vec<(f64, f64)> {
    let (mut z, mut points) = (start_m2, vec![(0.0, start_m2)]);
    for k in 0..1000u32 {
        points.push((delay_s + f64::from(k) * period_s, z.max(1e-9)));
        if z <= floor_m2 {
            break;
        }
        z = (z - decrease.position((2.0 * z).sqrt(), reach_m)).max(0.0);
    }
    points
}
