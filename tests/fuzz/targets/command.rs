use super::bytes::Bytes;
use clearway::actuation::Gate;
use clearway::model::{Command, Limits, RobotId};
use clearway::wire::{CommandHeader, Holding, RobotCommand, StopReason};

const MAX_HOLD_NS: u64 = 1_000;

/// The memory of one command that comes after the one of tick `last`, and whether the robot has stopped by
/// itself before. The first byte says what is as it should be.
fn offer(bytes: &mut Bytes, now_ns: u64, last: u64) -> (bool, CommandHeader, RobotCommand) {
    let shape = bytes.u8();
    let mut near = |bit: u8, base: u64| {
        if shape & bit == 0 { base.saturating_add(u64::from(bytes.u8())) } else { bytes.u64() }
    };
    let header = CommandHeader {
        epoch: near(1, 0),
        tick: near(2, 0),
        valid_from_ns: near(4, now_ns),
        valid_until_ns: near(8, now_ns),
        follows: if shape & 64 == 0 { last } else { bytes.u64() },
        ..CommandHeader::default()
    };
    let id = if shape & 16 == 0 { 3 } else { bytes.u32() };
    let stop_reason = u32::from(bytes.u8());
    let mut input = || if shape & 32 == 0 { f64::from(bytes.u8().cast_signed()) / 16.0 } else { bytes.f64() };
    (shape & 128 != 0, header, RobotCommand { id, stop_reason, v_mps: input(), omega_radps: input() })
}

/// Whatever stands in the memory of commands: what acts is a stop, or was accepted, is within the limits,
/// and is inside its validity at that very time; and who moves holds every command since a stop.
pub fn command(data: &[u8]) {
    let limits = Limits::default();
    let mut gate = Gate::new(RobotId(3), limits, MAX_HOLD_NS);
    let mut bytes = Bytes::new(data);
    let mut accepted: Vec<(CommandHeader, Command)> = Vec::new();
    let (mut now_ns, mut refused) = (0_u64, 0);
    // Epoch and tick of the command that the robot holds: of an unbroken sequence since a stop to begin with.
    let mut held: Option<(u64, u64)> = None;
    // When those begin that wait for their time; of three none can be kept.
    let mut waiting: Vec<u64> = Vec::new();
    for _ in 0..256 {
        if bytes.is_empty() {
            return;
        }
        now_ns = now_ns.saturating_add(u64::from(bytes.u8()));
        let last = accepted.last().map_or(0, |(last, _)| last.tick);
        let (halts, header, record) = offer(&mut bytes, now_ns, last);
        if halts {
            gate.halt();
            (held, waiting) = (None, Vec::new());
            assert_eq!((gate.input(now_ns), gate.holding(u64::MAX)), (Command::STOP, Holding::Nothing));
        }
        match gate.offer(&header, &record, now_ns) {
            Ok(()) => {
                let follows = held == Some((header.epoch, header.follows)) && header.valid_from_ns >= now_ns;
                assert!(follows || record.command() == Command::STOP, "{header:?} after {held:?}");
                let newest = accepted.last().map(|(last, _)| (last.epoch, last.tick));
                assert!(newest.is_none_or(|last| (header.epoch, header.tick) > last), "{header:?}");
                let first = header.epoch > newest.map_or(0, |(epoch, _)| epoch);
                held = match StopReason::from_code(record.stop_reason) {
                    _ if held == Some((header.epoch, header.follows)) => Some((header.epoch, header.tick)),
                    Some(StopReason::OutOfStep) => Some((header.epoch, header.tick)),
                    Some(StopReason::Start) if first => Some((header.epoch, header.tick)),
                    _ => held.filter(|(epoch, _)| *epoch == header.epoch),
                };
                waiting.retain(|from_ns| !first && *from_ns > now_ns && *from_ns < header.valid_from_ns);
                if waiting.len() == 2 {
                    (held, waiting) = (None, Vec::new());
                }
                waiting.push(header.valid_from_ns);
                accepted.push((header, record.command()));
            }
            Err(_) => refused += 1,
        }
        assert_eq!(gate.refused(), refused);
        let told = held.map_or(Holding::Nothing, |(_, tick)| Holding::Command { tick });
        assert_eq!(gate.holding(u64::MAX), told);
        assert!([told, Holding::Nothing].contains(&gate.holding(now_ns)));
        let (input, commanded) = (gate.input(now_ns), gate.is_commanded(now_ns));
        assert!(limits.admits(input), "{input:?}");
        let epoch = accepted.last().map_or(0, |(last, _)| last.epoch);
        let acts = |(h, c): &&(CommandHeader, Command)| {
            let hold_ns = h.valid_until_ns - h.valid_from_ns;
            let valid = (h.valid_from_ns..h.valid_until_ns).contains(&now_ns) && hold_ns <= MAX_HOLD_NS;
            valid && h.epoch == epoch && *c == input
        };
        assert_eq!(commanded, commanded && accepted.iter().any(|a| acts(&a)), "{input:?} at {now_ns}");
        assert!(commanded || input == Command::STOP, "{input:?} at {now_ns}");
        if let Some(next_ns) = gate.next_change_ns(now_ns) {
            assert!(next_ns > now_ns);
        }
    }
}
