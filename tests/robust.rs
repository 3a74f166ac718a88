//! Theorem 3 of docs/MATH.md over continuous time: robots that are disturbed within the bounds keep their
//! distance, whatever is asked of them and whatever the disturbance does.

use clearway::certificate::barrier::budget_m;
use clearway::certificate::robust::Margin;
use clearway::config::{Config, DisturbanceConfig, Pattern};
use clearway::controller::Timing;
use clearway::disturbance::{DisturbedFleet, Remaining};
use clearway::geometry::{Arc, Pose, Vec2, min_distance_arcs, unit};
use clearway::model::{Command, Disturbance, Limits, RobotId, RobotSpec};
use clearway::scenario::Scenario;
use proptest::prelude::*;

fn any_bounds() -> impl Strategy<Value = Disturbance> {
    let or_none = |most: f64| prop_oneof![1 => Just(0.0), 3 => 0.0..most];
    (or_none(0.1), or_none(0.2), or_none(0.3), or_none(0.5), or_none(0.15), or_none(0.08)).prop_map(
        |(position_m, heading_rad, slip, turn_rate_radps, lag_s, delay_s)| Disturbance {
            position_m,
            heading_rad,
            slip,
            turn_rate_radps,
            lag_s,
            delay_s,
        },
    )
}

/// A number in [−1, 1) that changes with `k`; often at its ends.
fn signal(seed: u64, k: u64) -> f64 {
    let mut z = (seed ^ k.wrapping_mul(0x9e37_79b9_7f4a_7c15)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    let x = 2.0 * ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64 - 1.0;
    if z.trailing_zeros() >= 2 { x } else { x.signum() }
}

/// Wheels integrated apart from the library's own, in fine steps of `h` seconds.
struct Wheels {
    lag_s: f64,
    late: usize,
    v_mps: f64,
    omega_radps: f64,
}

impl Wheels {
    fn follow(&mut self, command: Command, h: f64) {
        let kept = if self.lag_s > 0.0 { (-h / self.lag_s).exp() } else { 0.0 };
        self.v_mps = command.v_mps + (self.v_mps - command.v_mps) * kept;
        self.omega_radps = command.omega_radps + (self.omega_radps - command.omega_radps) * kept;
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1_500))]

    /// The heart of the proof: from an observation on, under the command in force, one more and then
    /// stops, with any turning, a robot stays within its reach and what the command adds to it.
    #[test]
    fn a_robot_stays_within_its_reach_in_every_direction(
        bounds in any_bounds(), share in prop_oneof![Just(1.0), 0.0..1.0f64],
        v_min in prop_oneof![Just(0.0), Just(-3.0)], seed in any::<u64>(), bearing in -3.1..3.1f64,
        steady in any::<bool>(), towards in any::<bool>(),
    ) {
        let t = 0.08;
        let limits = Limits { v_min_mps: v_min, ..Limits::default() };
        let margin = Margin::new(bounds, &limits, t, t);
        let n = unit(bearing);
        let history = 12u64;
        let command = |period: u64| {
            let x = signal(seed, if steady { 0 } else { period });
            let v_mps = if x > 0.0 { x * limits.v_max_mps } else { x * -limits.v_min_mps };
            Command { v_mps, omega_radps: signal(seed + 1, if steady { 0 } else { period }) }
        };
        // Periods 0 to `history` are held or past; `history` + 1 is the new one; then stops that turn.
        let told = |period: u64| match period {
            p if p <= history + 1 => command(p),
            p => Command { v_mps: 0.0, ..command(p) },
        };
        let mut remaining = Remaining::new(1, &bounds, t);
        for period in 0..history {
            remaining.hold(0, told(period));
        }
        let (travel_m, held, new) = (remaining.travel_m(0), told(history), told(history + 1));

        let per_period = 200u64;
        let h = t / per_period as f64;
        let mut wheels = Wheels {
            lag_s: bounds.lag_s * share,
            late: (1..=per_period).filter(|k| *k as f64 * h <= bounds.delay_s * share).count(),
            v_mps: 0.0,
            omega_radps: 0.0,
        };
        let mut pose = Pose::new(0.0, 0.0, signal(seed + 2, 0) * 3.0);
        let mut seen = None;
        for k in 0..(history + 2 + 20) * per_period {
            if k == history * per_period {
                let noise = unit(signal(seed + 3, 0) * 3.1) * bounds.position_m;
                let noise = if towards { n * bounds.position_m } else { noise };
                let p = pose.position_m + noise;
                let theta = pose.theta_rad + bounds.heading_rad * signal(seed + 4, 0);
                let arc = Arc { start: Pose::new(p.x, p.y, theta), v_mps: held.v_mps, omega_radps: held.omega_radps };
                seen = Some(arc.pose(t));
            }
            if let Some(seen) = seen.filter(|_| k >= (history + 1) * per_period) {
                let reach = margin.reach(travel_m, held);
                let along = n.dot(&seen.heading());
                let point = seen.position_m + seen.heading() * reach.lead_m;
                // A gap so wide that every motion is judged by its coefficient alone.
                let rate = margin.approach(along, 1e9, 1.0);
                let added = new.v_mps.abs() * if new.v_mps < 0.0 { rate.backward } else { rate.forward };
                let used = -n.dot(&(pose.position_m - point));
                let allowed = reach.towards_m(along) + added;
                // Euler's lag behind exact wheels, and a delay rounded to a step.
                prop_assert!(used <= allowed + 8.0 * h, "{used} of {allowed}: {bounds:?} {reach:?}");
            }
            let index = usize::try_from(k).unwrap();
            let command = index.checked_sub(wheels.late).map_or(Command::STOP, |k| told(k as u64 / per_period));
            wheels.follow(command, h);
            let towards_n = if towards { -n } else { unit(3.1 * signal(seed + 5, k / 20)) };
            let velocity = pose.heading() * wheels.v_mps + towards_n * (bounds.slip * wheels.v_mps.abs());
            let p = pose.position_m + velocity * h;
            let turn = if towards {
                // Towards the line: the sense that turns the heading, or its back, to −n.
                -pose.heading().perp(&n).signum() * if wheels.v_mps < 0.0 { -1.0 } else { 1.0 }
            } else {
                signal(seed + 6, k / 20)
            };
            pose = Pose::new(p.x, p.y, pose.theta_rad + (wheels.omega_radps + bounds.turn_rate_radps * turn) * h);
        }
    }

    /// No rate is negative, and a robot that stands is where it is seen but for the noise.
    #[test]
    fn rates_are_not_negative_and_reach_without_motion_is_the_noise(
        bounds in any_bounds(), along in -1.0..1.0f64, gap in -1.0..1.0f64, blind in 0.0..2.0f64,
    ) {
        let margin = Margin::new(bounds, &Limits::default(), 0.08, 0.08);
        let rate = margin.approach(along, gap, blind);
        prop_assert!(rate.forward >= 0.0 && rate.backward >= 0.0);
        prop_assert_eq!(margin.reach(0.0, Command::STOP).extent_m(), bounds.position_m);
    }
}

/// A crowd that is driven at its neighbours with saturated inputs, from noisy states and by lagging,
/// slipping wheels: nobody is ever closer than ρ, and with the margin left out somebody is.
fn press(
    bounds: Disturbance,
    amplitude: Disturbance,
    pattern: Pattern,
    v_min: f64,
    gamma: f64,
    seed: u64,
) -> (f64, f64) {
    let (t, n, radius_m) = (0.08, 9u32, 0.15);
    let limits = Limits { v_min_mps: v_min, ..Limits::default() };
    let spec = |k: u32| RobotSpec {
        id: RobotId(k),
        radius_m,
        start: Pose::new(f64::from(k % 3) * 1.2, f64::from(k / 3) * 1.2, 3.0 * signal(seed, u64::from(k))),
        goal_m: Vec2::zeros(),
        foreign_speed_mps: None,
    };
    let scenario = Scenario {
        name: "crowd".into(),
        tolerance_m: 0.05,
        duration_s: 60.0,
        limits,
        robots: (0..n).map(spec).collect(),
        obstacles: vec![],
    };
    let rho = scenario.required_distance_m(0, 1);
    let mut world = DisturbedFleet::new(&scenario, &DisturbanceConfig { pattern, seed, amplitude }, t);
    let margin = Margin::new(bounds, &limits, t, t);
    let mut remaining = Remaining::new(n as usize, &bounds, t);
    let robots = n as usize;
    let mut held = vec![Command::STOP; robots];
    let (mut closest, mut driven) = (f64::INFINITY, 0.0);
    for tick in 0..400u64 {
        // What is seen, carried to the end of the period, and where it may be from there.
        let seen: Vec<(Pose, _)> = (0..robots)
            .map(|i| {
                let start = world.seen(i, tick).unwrap();
                let arc = Arc { start, v_mps: held[i].v_mps, omega_radps: held[i].omega_radps };
                let (pose, reach) = (arc.pose(t), margin.reach(remaining.travel_m(i), held[i]));
                (Pose { position_m: pose.position_m + pose.heading() * reach.lead_m, ..pose }, reach)
            })
            .collect();
        let next: Vec<Command> = (0..robots)
            .map(|i| {
                let k = tick * 16 + i as u64;
                // Home when far out, and mostly straight on at full speed.
                let home = Vec2::new(1.2, 1.2) - seen[i].0.position_m;
                let far = home.norm() > 1.5;
                let omega =
                    if far { seen[i].0.heading().perp(&home).signum() } else { signal(seed + 1, k / 16) };
                let ahead = !far || seen[i].0.heading().dot(&home) > 0.0 || v_min == 0.0;
                let mut v: f64 = if ahead { limits.v_max_mps } else { v_min };
                if signal(seed + 2, k) > 0.999 {
                    v = 0.0;
                }
                for j in (0..robots).filter(|j| *j != i) {
                    let offset = seen[i].0.position_m - seen[j].0.position_m;
                    let d = offset.norm();
                    let normal = offset / d;
                    let along = normal.dot(&seen[i].0.heading());
                    let theirs = seen[j].1.towards_m(-normal.dot(&seen[j].0.heading()));
                    let gap = d - rho - seen[i].1.towards_m(along) - theirs;
                    let blind = (seen[i].1.extent_m() + seen[j].1.extent_m()) / d;
                    let rate = margin.approach(along, gap, blind);
                    let limit =
                        |rate: f64| if rate > 0.0 { budget_m(gap, gamma, 0.5) / rate } else { f64::INFINITY };
                    v = if v >= 0.0 { v.min(limit(rate.forward)) } else { v.max(-limit(rate.backward)) };
                }
                Command { v_mps: v, omega_radps: omega }
            })
            .collect();
        for (i, command) in held.iter().enumerate() {
            remaining.hold(i, *command);
        }
        for _ in 0..DisturbedFleet::STEPS {
            let step_s = world.step_s();
            let arcs = world.step(|i| held[i]);
            for (i, arc) in arcs.iter().enumerate() {
                driven += arc.v_mps.abs() * step_s;
                for other in &arcs[..i] {
                    closest = f64::min(closest, min_distance_arcs(arc, other, step_s).lower_m - rho);
                }
            }
        }
        held = next;
    }
    (closest, driven)
}

/// The bounds that the suite runs at.
const FULL: Disturbance = Disturbance {
    position_m: 0.02,
    heading_rad: 0.02,
    slip: 0.05,
    turn_rate_radps: 0.05,
    lag_s: 0.05,
    delay_s: 0.08,
};

#[test]
fn pressing_crowd_keeps_its_distance_under_every_disturbance_within_the_bounds() {
    let none = Disturbance::NONE;
    let kinds = [
        Disturbance { position_m: 0.05, ..none },
        Disturbance { heading_rad: 0.1, ..none },
        Disturbance { slip: 0.2, turn_rate_radps: 0.3, ..none },
        Disturbance { lag_s: 0.05, ..none },
        Disturbance { delay_s: 0.08, ..none },
        FULL,
    ];
    let mut runs = 0;
    for bounds in kinds {
        for pattern in [Pattern::Random, Pattern::Adversarial] {
            for (v_min, gamma, share) in [(0.0, 1.0, 1.0), (-3.0, 1.0, 1.0), (0.0, 0.4, 1.0), (0.0, 1.0, 0.5)]
            {
                runs += 1;
                let (closest, driven) = press(bounds, bounds.scaled(share), pattern, v_min, gamma, runs);
                assert!(closest >= -1e-9, "{closest}: {bounds:?} {pattern:?} {v_min} {gamma} {share}");
                assert!(driven > 8.0, "they have to move: {driven} {bounds:?} {pattern:?} {v_min} {gamma}");
            }
        }
    }
}

/// A robot that goes silent at steady speed still travels what its wheels are behind: that is ahead of
/// where the commands since its last good pose lead to.
#[test]
fn a_lost_robot_rests_within_what_its_silence_adds() {
    let limits = Limits { v_max_mps: 1.0, omega_min_radps: -0.1, omega_max_radps: 0.1, ..Limits::default() };
    let (t, per_period) = (0.08, 200);
    let h = t / f64::from(per_period);
    for (lag_s, silent_periods) in [(1.0, 2), (1.0, 6), (0.3, 2)] {
        let bounds = Disturbance { lag_s, ..Disturbance::NONE };
        let margin = Margin::new(bounds, &limits, t, t);
        let go = Command { v_mps: limits.v_max_mps, omega_radps: 0.0 };
        // Since long at full speed when last seen, then on for its silence, then told to stop.
        let mut wheels = Wheels { lag_s, late: 0, v_mps: go.v_mps, omega_radps: 0.0 };
        let (mut travelled_m, mut carried_m) = (0.0, 0.0);
        for k in 0..(silent_periods + 400) * per_period {
            let command = if k < silent_periods * per_period { go } else { Command::STOP };
            wheels.follow(command, h);
            travelled_m += wheels.v_mps * h;
            carried_m += command.v_mps * h;
        }
        let ahead_m = travelled_m - carried_m;
        assert!((ahead_m - limits.v_max_mps * lag_s).abs() < 0.01, "{ahead_m} with a lag of {lag_s} s");
        let added_m = margin.lost_m(f64::from(silent_periods) * t);
        assert!(added_m >= ahead_m, "{added_m} for {ahead_m} with a lag of {lag_s} s");
    }
}

#[test]
fn without_the_margin_the_same_crowd_comes_too_close() {
    let none = Disturbance::NONE;
    for (kind, least) in [
        (Disturbance { position_m: 0.05, ..none }, 0.02),
        (Disturbance { heading_rad: 0.1, ..none }, 1e-4),
        (Disturbance { slip: 0.2, ..none }, 1e-3),
        (Disturbance { lag_s: 0.05, ..none }, 0.01),
        (Disturbance { delay_s: 0.08, ..none }, 0.05),
        (FULL, 0.05),
    ] {
        let (closest, _) = press(none, kind, Pattern::Adversarial, 0.0, 1.0, 1);
        assert!(closest < -least, "{closest}: {kind:?}");
    }
}

#[test]
fn bounds_of_zero_change_no_bit() {
    let run = |set: &[&str]| {
        let mut fleets = Vec::new();
        let config = Config::with_overrides(None, set).unwrap();
        clearway::evaluation::run(&config, Timing::default(), |_, fleet| fleets.push(fleet.to_vec()))
            .unwrap();
        fleets
    };
    let plain = run(&["scenario=random-8-3"]);
    let zero =
        run(&["scenario=random-8-3", "robust.lag_us=0", "disturbance.position_m=0", "disturbance.seed=9"]);
    assert_eq!(plain, zero);
}
