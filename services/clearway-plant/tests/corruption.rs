//! Bits flip in the shared memory of a running fleet: nobody moves by what they say.

mod support;

use std::fs::{File, OpenOptions};
use std::ops::Range;
use std::os::unix::fs::FileExt;

use clearway::channel::{
    Attachment, CommandReader, ObservationReader, Received, Record, StateReader, Transport,
};
use clearway::scenario::Scenario;
use clearway::wire::{CommandHeader, RobotCommand, StopReason};
use support::{World, assert_obeyed, clearance, client, daemon, plant, report, trajectory, until};

/// Flips bits of samples where they lie, through the files that are mapped there.
struct Flipper {
    /// Addresses of this process, the file behind them, and where in it they begin.
    maps: Vec<(Range<u64>, File, u64)>,
    random: u64,
}

impl Flipper {
    fn new() -> Self {
        Self { maps: Vec::new(), random: 1 }
    }

    /// The next number below `end` of a sequence that is always the same.
    fn below(&mut self, end: usize) -> usize {
        self.random =
            self.random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        usize::try_from(self.random >> 33).unwrap() % end
    }

    fn look(&mut self) {
        self.maps.clear();
        let hex = |text: &str| u64::from_str_radix(text, 16).unwrap();
        for line in std::fs::read_to_string("/proc/self/maps").unwrap().lines() {
            let parts: Vec<&str> = line.split_whitespace().collect();
            if let [span, _, at, _, _, path] = parts[..]
                && path.starts_with("/dev/shm/cw_")
                && let Ok(file) = OpenOptions::new().read(true).write(true).open(path)
            {
                let (first, last) = span.split_once('-').unwrap();
                self.maps.push((hex(first)..hex(last), file, hex(at)));
            }
        }
    }

    fn flip_at(&mut self, address: u64, bit: usize) -> bool {
        let Some((span, file, start)) = self.maps.iter().find(|(span, ..)| span.contains(&address)) else {
            self.look();
            return false;
        };
        let (at, mut byte) = (start + address - span.start, [0]);
        file.read_exact_at(&mut byte, at).unwrap();
        file.write_all_at(&[byte[0] ^ 1 << bit], at).unwrap();
        true
    }

    /// Flips one bit of the header or of the records; whether it is flipped.
    fn hit<R: Record>(&mut self, sample: &Received<R>) -> bool {
        let (head, body) = (size_of::<R::Header>(), size_of_val(sample.robots()));
        let (at, bit) = (self.below(head + body), self.below(8));
        let address = if at < head {
            std::ptr::from_ref(sample.header()).addr() + at
        } else {
            sample.robots().as_ptr().addr() + at - head
        };
        let hit = self.flip_at(address as u64, bit);
        assert!(!hit || !sample.is_intact(), "byte {at} of {}, bit {bit}", R::CHANNEL.name());
        hit
    }
}

/// Somebody who reads every sample first, and then spoils it for the others.
struct Saboteur {
    flipper: Flipper,
    states: StateReader,
    commands: CommandReader,
    observations: ObservationReader,
    heard: Vec<(CommandHeader, Vec<RobotCommand>)>,
    hits: [u64; 3],
}

impl Saboteur {
    fn new(node: &Attachment) -> Self {
        Self {
            flipper: Flipper::new(),
            states: until(|| node.reader().ok()),
            commands: until(|| node.reader().ok()),
            observations: until(|| node.reader().ok()),
            heard: Vec::new(),
            hits: [0; 3],
        }
    }

    /// Takes what came; spoils some of it if `active`.
    fn work(&mut self, active: bool) {
        // Workers read a state at once: it comes first.
        while let Some(sample) = self.states.next().unwrap() {
            self.hits[0] += u64::from(active && self.flipper.hit(&sample));
        }
        while let Some(sample) = self.commands.next().unwrap() {
            self.heard.push((*sample.header(), sample.robots().to_vec()));
            // Not all, so that robots move as well.
            let chosen = active && self.flipper.below(3) == 0;
            self.hits[1] += u64::from(chosen && self.flipper.hit(&sample));
        }
        while let Some(sample) = self.observations.next().unwrap() {
            let chosen = active && self.flipper.below(3) == 0;
            self.hits[2] += u64::from(chosen && self.flipper.hit(&sample));
        }
    }

    fn stops(&self, reason: StopReason) -> usize {
        self.heard.iter().flat_map(|(_, robots)| robots).filter(|r| r.stop_reason == reason as u32).count()
    }
}

#[test]
fn nobody_moves_by_bits_that_flipped_in_shared_memory() {
    let world = World::new("flips");
    let mut control = daemon(&world, &["--report", "daemon.json"]);
    let client = client(&world);
    let node = Transport::new("default", &world.channel).unwrap().visit("saboteur").unwrap();
    let mut saboteur = Saboteur::new(&node);
    let robots = plant(&world, "all", &["--once"]);
    let mut rounds = 0_u64;
    until(|| {
        // Without a pause most of the time: a worker reads the state within microseconds.
        for _ in 0..10_000 {
            saboteur.work(true);
        }
        rounds += 1;
        let enough = saboteur.hits.iter().all(|hits| *hits >= 20) && saboteur.stops(StopReason::Corrupt) > 0;
        (enough || control.0.try_wait().unwrap().is_some()).then_some(())
    });
    let (hits, corrupt_stops) = (saboteur.hits, saboteur.stops(StopReason::Corrupt));
    until(|| {
        saboteur.work(false);
        std::thread::sleep(std::time::Duration::from_millis(1));
        control.0.try_wait().unwrap()
    });
    saboteur.work(false);
    drop((node, client));
    control.succeed();
    robots.succeed();

    let (own, main) = (report(&world, "all"), report(&world, "daemon"));
    assert!(hits.iter().all(|hits| *hits >= 20) && corrupt_stops > 0, "{hits:?} in {rounds} rounds: {main}");
    // All of it is noticed by whom it hits, under its own name.
    assert!(main["corrupt_states"].as_u64() >= Some(1), "{main}");
    assert!(main["rejected_inputs"]["corrupt"].as_u64() >= Some(1), "{main}");
    assert!(own["commands"]["corrupt"].as_u64() >= Some(1), "{own}");
    // Nothing that was spoilt came as far as the gates, and robots moved only as they were told.
    assert_eq!(own["commands"]["refused"].as_u64(), Some(0), "{own}");
    let records = trajectory(&world, "all");
    assert_obeyed(&saboteur.heard, &records);
    let (clearance_m, violations) = clearance(&Scenario::builtin("swap8").unwrap(), &records);
    assert_eq!(violations, 0, "{clearance_m} m");
    // Once it is over, everything goes on as if nothing had been.
    assert_eq!((main["arrived"].as_u64(), own["arrived"].as_u64()), (Some(8), Some(8)), "{main} {own}");
}
