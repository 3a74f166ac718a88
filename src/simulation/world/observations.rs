//! Observations on their way to the daemon, and what befalls them.

use std::sync::Arc;

use super::{FLEET, World, flip};
use crate::channel::Channel;
use crate::channel::memory::Message;
use crate::simulation::active::Active;
use crate::simulation::kind::{Kind, Scope};
use crate::simulation::plan::Fault;
use crate::wire::{Holding, ObservationHeader, RobotObservation};

impl World {
    /// Drivers take the poses of the next period and send them, if it is time.
    pub(crate) fn observe(&mut self, now_ns: u64, active: &mut [Active], present: impl Fn(usize) -> bool) {
        let due_ns = (self.start_ns + self.next * self.period_ns).saturating_sub(self.lead_ns);
        if now_ns < due_ns {
            return;
        }
        let period = self.next;
        self.next += 1;
        // Before its driver looks, or just after, so that the daemon takes it to drive for a period more.
        self.halt(period, active, |chance| chance < 0.5);
        for at in 0..self.drivers.len() {
            self.send(at, now_ns, period, active, &present);
        }
        self.halt(period, active, |chance| chance >= 0.5);
    }

    fn halt(&mut self, period: u64, active: &mut [Active], now: impl Fn(f64) -> bool) {
        for one in active.iter_mut() {
            if one.kind() == Kind::Halted && one.acts_at(period) && now(one.fault.chance) {
                self.plant.halt(one.fault.target);
                one.applied += 1;
            }
        }
    }

    #[expect(clippy::too_many_lines, reason = "an arm for each fault that meets an observation on its way")]
    fn send(
        &mut self,
        at: usize,
        now_ns: u64,
        period: u64,
        active: &mut [Active],
        present: &impl Fn(usize) -> bool,
    ) {
        let robots: Vec<usize> =
            self.drivers[at].robots.iter().copied().filter(|index| present(*index)).collect();
        let driver = &mut self.drivers[at];
        let mut header = ObservationHeader {
            epoch: driver.epoch,
            sequence: driver.sequence,
            stamp_ns: now_ns,
            ..ObservationHeader::default()
        };
        let mut records: Vec<RobotObservation> = robots
            .iter()
            .map(|index| {
                let pose = self.plant.pose(*index).unwrap_or_default();
                let (x_m, y_m) = (pose.position_m.x, pose.position_m.y);
                let holding = if self.untold { Holding::Untold } else { self.plant.holding(*index) };
                let (id, holding) = (self.ids[*index], holding.code());
                RobotObservation { id, holding, x_m, y_m, theta_rad: pose.theta_rad }
            })
            .collect();
        let (mut times, mut again, mut pretender) = (1, None, None);
        for which in 0..active.len() {
            let one = &active[which];
            if !one.acts_at(period) || one.kind() == Kind::Begin {
                continue;
            }
            let (kind, fault) = (one.kind(), one.fault);
            let place = robots.iter().position(|index| *index == fault.target);
            let done = if fault.kind.promise().scope == Scope::Robot {
                let Some(place) = place else { continue };
                match kind {
                    Kind::ObsMasquerade => {
                        let alone = active.iter().all(|other| {
                            other.fault.number == fault.number
                                || !other.acts_within(period)
                                || !other.touches(fault.target)
                        });
                        if alone {
                            let record = &records[place];
                            pretender = Some(RobotObservation { x_m: record.x_m + 3.0, ..*record });
                        }
                        alone
                    }
                    Kind::ObsFrozen => {
                        let real = self.plant.pose(fault.target).unwrap_or_default();
                        let seen = *self.frozen[fault.target].get_or_insert(real);
                        let record = &mut records[place];
                        (record.x_m, record.y_m, record.theta_rad) =
                            (seen.position_m.x, seen.position_m.y, seen.theta_rad);
                        // Seen only of a robot that is told to drive all of the time.
                        let off_m = (real.position_m - seen.position_m).norm();
                        let told = active[which].applied;
                        active[which].armed = told >= 11 && off_m > 0.2 * told as f64;
                        if period == fault.last() {
                            self.frozen[fault.target] = None;
                        }
                        true
                    }
                    _ => spoil(&fault, &mut records[place]),
                }
            } else if fault.target != at {
                false
            } else {
                let driver = &mut self.drivers[at];
                match kind {
                    Kind::ObsSilence => {
                        times = 0;
                        active[which].applied += 1;
                        continue;
                    }
                    Kind::DriverRestart => {
                        (driver.writer, driver.sequence) = (self.memory.identity(), 1);
                        header.sequence = 1;
                        true
                    }
                    Kind::ObsLost => {
                        times = 0;
                        driver.sequence = driver.sequence.wrapping_add(1);
                        true
                    }
                    Kind::ObsDuplicate if records.len() > 1 => {
                        let last = records.len() - 1;
                        records[last] = records[0];
                        true
                    }
                    Kind::ObsOversize => {
                        let filler = RobotObservation { id: u32::MAX - 7, ..RobotObservation::default() };
                        records.resize(self.ids.len() + 4, filler);
                        true
                    }
                    Kind::ObsOldEpoch if header.epoch > 0 => {
                        header.epoch -= 1;
                        true
                    }
                    Kind::ObsStale => {
                        header.stamp_ns = now_ns.saturating_sub(5 * self.period_ns);
                        true
                    }
                    Kind::ObsFuture => {
                        header.stamp_ns = now_ns + 3 * self.period_ns;
                        true
                    }
                    Kind::ObsGap => {
                        header.sequence = header.sequence.wrapping_add(4_000_000);
                        true
                    }
                    Kind::ObsRepeated => {
                        times = times.min(1) * 2;
                        true
                    }
                    Kind::ObsReordered => {
                        again.clone_from(&driver.sent);
                        again.is_some()
                    }
                    _ => false,
                }
            };
            active[which].applied += u64::from(done);
        }
        let driver = &mut self.drivers[at];
        let seal = Channel::Observation.seal(FLEET);
        seal.put(&mut header, &records);
        let mut message = Message { writer: driver.writer, header, robots: Arc::from(records) };
        for one in active.iter_mut() {
            if one.kind() == Kind::ObsBit && one.fault.target == at && one.acts_at(period) && times > 0 {
                flip(&mut message, one.fault.chance, one.applied);
                one.applied += 1;
            }
        }
        if times > 0 {
            driver.sequence = driver.sequence.wrapping_add(1);
            driver.sent = Some(message.clone());
        }
        for _ in 0..times {
            self.memory.observation.send(&message);
        }
        if let Some(older) = again {
            self.memory.observation.send(&older);
        }
        if let Some(record) = pretender {
            let mut header = ObservationHeader { sequence: self.false_sequence, ..header };
            seal.put(&mut header, &[record]);
            self.false_sequence += 1;
            let robots = Arc::from(&[record][..]);
            self.memory.observation.send(&Message { writer: self.false_writer, header, robots });
        }
    }
}

/// Makes one robot's record wrong; whether the kind is about that.
fn spoil(fault: &Fault, record: &mut RobotObservation) -> bool {
    let chance = fault.chance;
    let bad = match fault.kind {
        Kind::ObsNotFinite => [f64::NAN, f64::INFINITY, f64::NEG_INFINITY][(chance * 3.0) as usize % 3],
        Kind::ObsSubnormal => 1e-310,
        Kind::ObsOutOfRange => {
            record.x_m = if chance < 0.5 { 1e9 } else { -f64::MAX };
            return true;
        }
        Kind::ObsUnknownRobot => {
            record.id = u32::MAX - 9;
            return true;
        }
        Kind::ObsTeleport => {
            record.x_m += 3.0 + 30.0 * chance;
            return true;
        }
        _ => return false,
    };
    match fault.coordinate() {
        0 => record.x_m = bad,
        1 => record.y_m = bad,
        _ => record.theta_rad = bad,
    }
    true
}
