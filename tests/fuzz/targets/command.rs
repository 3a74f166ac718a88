use super::bytes::Bytes;
use clearway::actuation::Gate;
use clearway::model::{Command, Limits, RobotId};
use clearway::wire::{CommandHeader, RobotCommand};

const MAX_HOLD_NS: u64 = 1_000;

/// The memory of one command, and when it is looked at.
fn offer(bytes: &mut Bytes, now_ns: u64) -> (CommandHeader, RobotCommand) {
    let shape = bytes.u8();
    let mut near = |bit: u8, base: u64| {
        if shape & bit == 0 { base.saturating_add(u64::from(bytes.u8())) } else { bytes.u64() }
    };
    let header = CommandHeader {
        epoch: near(1, 0),
        tick: near(2, 0),
        valid_from_ns: near(4, now_ns),
        valid_until_ns: near(8, now_ns),
        ..CommandHeader::default()
    };
    let id = if shape & 16 == 0 { 3 } else { bytes.u32() };
    let stop_reason = u32::from(bytes.u8());
    let mut input = || if shape & 32 == 0 { f64::from(bytes.u8().cast_signed()) / 16.0 } else { bytes.f64() };
    (header, RobotCommand { id, stop_reason, v_mps: input(), omega_radps: input() })
}

/// Whatever stands in the memory of commands: what acts is a stop, or was accepted, is within the limits,
/// and is inside its validity at that very time.
pub fn command(data: &[u8]) {
    let limits = Limits::default();
    let mut gate = Gate::new(RobotId(3), limits, MAX_HOLD_NS);
    let mut bytes = Bytes::new(data);
    let mut accepted: Vec<(CommandHeader, Command)> = Vec::new();
    let (mut now_ns, mut refused) = (0_u64, 0);
    for _ in 0..256 {
        if bytes.is_empty() {
            return;
        }
        now_ns = now_ns.saturating_add(u64::from(bytes.u8()));
        let (header, record) = offer(&mut bytes, now_ns);
        match gate.offer(&header, &record, now_ns) {
            Ok(()) => {
                let newest = accepted.last().map(|(last, _)| (last.epoch, last.tick));
                assert!(newest.is_none_or(|last| (header.epoch, header.tick) > last), "{header:?}");
                accepted.push((header, record.command()));
            }
            Err(_) => refused += 1,
        }
        assert_eq!(gate.refused(), refused);
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
