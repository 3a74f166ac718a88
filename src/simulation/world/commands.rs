//! Commands on their way to the drivers, and what befalls them.

use std::collections::VecDeque;
use std::sync::Arc;

use super::{FLEET, World, flip};
use crate::channel::Channel;
use crate::channel::memory::Message;
use crate::simulation::active::Active;
use crate::simulation::kind::Kind;
use crate::wire::RobotCommand;

impl World {
    /// Drivers take what has come for them by `now_ns`.
    pub(crate) fn receive(&mut self, now_ns: u64, active: &mut [Active]) {
        let period = self.period(now_ns);
        for at in 0..self.drivers.len() {
            let mut due = VecDeque::new();
            self.drivers[at].late.retain(|(due_ns, message)| {
                let comes = *due_ns <= now_ns;
                if comes {
                    due.push_back(message.clone());
                }
                !comes
            });
            let Some(queue) = self.drivers[at].commands.queue().cloned() else { continue };
            for message in queue.edit(std::mem::take) {
                self.carry(at, &message, (now_ns, period), active, &mut due);
            }
            queue.edit(|waiting| *waiting = due);
            // As every receiver: what is not as it was sealed is not handed out.
            while let Ok(Some(sample)) = self.drivers[at].commands.next() {
                let (header, robots) = (*sample.header(), Arc::from(sample.robots()));
                self.deliver(at, &Message { writer: sample.writer(), header, robots }, now_ns);
            }
        }
        self.outside.corrupt = self.drivers.iter().map(|driver| driver.commands.corrupt()).sum();
    }

    /// One command sample on its way to driver `at`.
    fn carry(
        &mut self,
        at: usize,
        message: &Message<RobotCommand>,
        (now_ns, period): (u64, u64),
        active: &mut [Active],
        due: &mut VecDeque<Message<RobotCommand>>,
    ) {
        let mut copies = 1;
        for one in active.iter_mut().filter(|one| one.acts_at(period)) {
            let (kind, target) = (one.kind(), one.fault.target);
            let driver = &mut self.drivers[at];
            let mine = target == at;
            match kind {
                Kind::CmdLost if mine => copies = 0,
                Kind::CmdLate if mine => {
                    driver.late.push((now_ns + self.period_ns * 11 / 5, message.clone()));
                    copies = 0;
                }
                Kind::CmdRepeated if mine => copies *= 2,
                Kind::CmdBit if mine => {
                    let mut flipped = message.clone();
                    flip(&mut flipped, one.fault.chance, one.applied);
                    due.push_back(flipped);
                    copies = 0;
                }
                Kind::CmdOldEpoch if mine => {
                    let mut old = message.clone();
                    old.header.epoch -= 1;
                    old.header.tick = old.header.tick.wrapping_add(3);
                    Channel::Command.seal(FLEET).put(&mut old.header, &old.robots);
                    // Behind the real one: before it no newer run may be known.
                    due.push_back(message.clone());
                    due.push_back(old);
                    copies = 0;
                }
                Kind::CmdWrongRobot | Kind::CmdWild | Kind::CmdForever if driver.robots.contains(&target) => {
                    let (id, mut false_one) = (self.ids[target], message.clone());
                    let mut robots = false_one.robots.to_vec();
                    for robot in robots.iter_mut().filter(|robot| robot.id == id) {
                        match kind {
                            Kind::CmdWild => (robot.v_mps, robot.stop_reason) = (f64::NAN, 0),
                            Kind::CmdForever => false_one.header.valid_until_ns += 100 * self.period_ns,
                            _ => {}
                        }
                    }
                    false_one.robots = Arc::from(robots);
                    let claimed = if kind == Kind::CmdWrongRobot { id.wrapping_add(1) } else { id };
                    self.hand_over(target, claimed, &false_one, now_ns);
                }
                _ => continue,
            }
            one.applied += 1;
        }
        for _ in 0..copies {
            due.push_back(message.clone());
        }
    }

    fn deliver(&mut self, at: usize, message: &Message<RobotCommand>, now_ns: u64) {
        let driver = &mut self.drivers[at];
        driver.epoch = driver.epoch.max(message.header.epoch);
        for index in driver.robots.clone() {
            if message.robots.iter().any(|one| one.id == self.ids[index]) {
                self.hand_over(index, self.ids[index], message, now_ns);
            }
        }
    }

    /// Offers robot `index` what `message` says about it, under the name `claimed`.
    fn hand_over(&mut self, index: usize, claimed: u32, message: &Message<RobotCommand>, now_ns: u64) {
        let id = self.ids[index];
        let Some(own) = message.robots.iter().find(|one| one.id == id) else { return };
        let (mut header, command) = (message.header, RobotCommand { id: claimed, ..*own });
        if self.ignores_expiry {
            header.valid_until_ns = u64::MAX;
        }
        if let Err(refusal) = self.plant.command(index, &header, &command, now_ns) {
            self.outside.count(refusal);
        }
    }
}
