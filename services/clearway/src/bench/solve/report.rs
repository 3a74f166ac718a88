//! The report of `clearway bench solve`: as JSON and as a table.

use super::measure::Case;
use crate::bench::machine::Machine;
use serde::Serialize;
use std::fmt::Write;

/// How the figures were taken.
#[derive(Debug, Serialize)]
pub(super) struct Method {
    problems: &'static str,
    exact_ns: &'static str,
    exact_repeated_ns: &'static str,
    exact_mean_ns: &'static str,
    clarabel_ns: &'static str,
    clarabel_raw_ns: &'static str,
    clarabel_cold_ns: &'static str,
    gaps: &'static str,
}

const METHOD: Method = Method {
    problems: "what moving robots solved in closed-loop runs of the scenarios, evenly spaced over them; neighbours \
               counts the bodies with a row; samples_from_smaller of them come from \
 scenarios made smaller (NAME@SCALE), to fill up; robots that hold at their goals are left out",
    exact_ns: "each problem copied into a workspace and solved once, in the order of the runs, between two readings of the clock, whose own cost \
               clock_ns is part of the figure; the quantiles are over problems",
    exact_repeated_ns: "each problem 100 times in a row, over 100: no clock in it, but the processor has learnt the \
                        problem's branches",
    exact_mean_ns: "all problems one after another between two readings of the clock, over their number: no clock in \
                    it, and branches that are not learnt; the median of 21 passes",
    clarabel_ns: "as exact_ns; the workspace is kept and its data updated, and the last digits are polished, as the \
                  controller uses it",
    clarabel_raw_ns: "as clarabel_ns without the polishing",
    clarabel_cold_ns: "as exact_ns; a solver of just the right size is built, used once and dropped",
    gaps: "max_* between the exact solver and Clarabel polished, raw_max_* Clarabel as it ends; objective relative to \
           1 + |objective|, inputs in m/s and rad/s",
};

/// The whole report.
#[derive(Debug, Serialize)]
pub(super) struct Report {
    pub(super) machine: Machine,
    pub(super) method: Method,
    pub(super) scenarios: Vec<String>,
    pub(super) cases: Vec<Case>,
}

impl Report {
    pub(super) fn new(machine: Machine, scenarios: Vec<String>, cases: Vec<Case>) -> Self {
        Self { machine, method: METHOD, scenarios, cases }
    }

    pub(super) fn table(&self) -> String {
        let mut out = String::new();
        let m = &self.machine;
        // Writing to a string cannot fail.
        let _ = writeln!(out, "{}, {}", m.cpu, m.kernel);
        let _ = writeln!(
            out,
            "Times of single solves contain the clock's own, {:.0} ns at the median and {:.0} ns at the 99th \
             percentile; `repeated` and `mean` do not.\n",
            m.clock_ns.p50, m.clock_ns.p99
        );
        let _ = writeln!(
            out,
            "{:>10} {:>8} │ {:^33} {:>8} {:>8} │ {:^26} {:>8} {:>9} │ {:>6} │ {:>9} {:>9}",
            "", "", "exact ns", "repeated", "mean", "Clarabel µs", "raw", "anew", "", "objective", "input"
        );
        let _ = writeln!(
            out,
            "{:>10} {:>8} │ {:>7} {:>7} {:>8} {:>8} {:>8} {:>8} │ {:>8} {:>8} {:>8} {:>8} {:>9} │ {:>6} │ {:>9} {:>9}",
            "neighbours",
            "samples",
            "p50",
            "p99",
            "p99.9",
            "max",
            "p50",
            "",
            "p50",
            "p99",
            "p99.9",
            "p50",
            "p50",
            "ratio",
            "gap",
            "gap"
        );
        for case in &self.cases {
            let _ = writeln!(out, "{}", row(case));
        }
        out
    }
}

fn row(case: &Case) -> String {
    let (e, c) = (&case.exact_ns, &case.clarabel_ns);
    let us = |ns: f64| ns / 1e3;
    format!(
        "{:>10} {:>8} │ {:>7.0} {:>7.0} {:>8.0} {:>8.0} {:>8.1} {:>8.1} │ {:>8.1} {:>8.1} {:>8.1} {:>8.1} {:>9.1} │ \
         {:>6.0} │ {:>9.0e} {:>9.0e}",
        case.neighbours,
        case.samples,
        e.p50,
        e.p99,
        e.p999,
        e.max,
        case.exact_repeated_ns.p50,
        case.exact_mean_ns,
        us(c.p50),
        us(c.p99),
        us(c.p999),
        us(case.clarabel_raw_ns.p50),
        us(case.clarabel_cold_ns.p50),
        case.ratio_p50,
        case.gaps.max_objective_gap_rel,
        case.gaps.max_input_gap,
    )
}
