use bytemuck::{Pod, bytes_of, cast_slice};
use crc32fast::Hasher;

use super::{CheckpointHeader, CommandHeader, ObservationHeader, StateHeader, TelemetryHeader};

/// What every header of a sample ends with: how many records follow, and the checksum over all of it.
pub trait Header: Pod + Default {
    /// Records of the sample.
    fn records(&self) -> u32;

    /// The checksum; the last field, and the only one that it does not cover.
    fn checksum(&self) -> u32;

    /// Writes both.
    fn set(&mut self, records: u32, checksum: u32);
}

macro_rules! header {
    ($($header:ident),+) => {$(
        impl Header for $header {
            fn records(&self) -> u32 {
                self.records
            }

            fn checksum(&self) -> u32 {
                self.checksum
            }

            fn set(&mut self, records: u32, checksum: u32) {
                (self.records, self.checksum) = (records, checksum);
            }
        }
    )+};
}

header!(CheckpointHeader, CommandHeader, ObservationHeader, StateHeader, TelemetryHeader);

/// Bytes that are filled and summed up at a time: they and what they come from stay in the first cache.
const BLOCK_BYTES: usize = 16 << 10;

/// Proves that a sample is what its writer wrote, on the channel that it is read from.
///
/// The checksum is CRC-32 (IEEE 802.3; `crc32` of zlib) of the channel's full name, the bytes of the
/// header before its last field, and the bytes of the records, in this order. It finds every flipped
/// bit, every burst of up to 32 bits, all but one in 2³² of any other change, and samples of another
/// channel or fleet. It is no protection against somebody who means harm: he can compute it as well.
///
/// 70 ns for the state of 8 robots, 0.21 ms for that of 100,000 (docs/CHANNELS.md); allocates nothing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Seal {
    /// CRC-32 of the channel's name.
    seed: u32,
}

impl Seal {
    /// The seal of the channel with this full name, `clearway/<fleet>/v1/<channel>`.
    pub fn of(service: &str) -> Self {
        Self { seed: crc32fast::hash(service.as_bytes()) }
    }

    /// The checksum of a sample. What stands in the header's own checksum does not count.
    pub fn checksum<H: Header, R: Pod>(self, header: &H, records: &[R]) -> u32 {
        let mut crc = self.begin(header);
        crc.update(cast_slice(records));
        crc.finalize()
    }

    /// The sum over the header.
    fn begin<H: Header>(self, header: &H) -> Hasher {
        let head = bytes_of(header);
        let covered = head.len() - size_of::<u32>();
        let mut crc = Hasher::new_with_initial(self.seed);
        crc.update(&head[..covered]);
        crc
    }

    /// Lets `fill` write the records, a few at a time from the given one on, and completes the header; what is
    /// covered is still near when it is summed up.
    pub fn put_in_blocks<H: Header, R: Pod>(
        self,
        header: &mut H,
        records: &mut [R],
        mut fill: impl FnMut(usize, &mut [R]),
    ) {
        header.set(count(records), 0);
        let mut crc = self.begin(header);
        let block = (BLOCK_BYTES / size_of::<R>().max(1)).max(1);
        for (index, block_of) in records.chunks_mut(block).enumerate() {
            fill(index * block, block_of);
            crc.update(cast_slice(block_of));
        }
        header.set(count(records), crc.finalize());
    }

    /// Completes a header.
    pub fn put<H: Header, R: Pod>(self, header: &mut H, records: &[R]) {
        header.set(count(records), 0);
        header.set(count(records), self.checksum(header, records));
    }

    /// Whether header and records are what was sealed.
    pub fn holds<H: Header, R: Pod>(self, header: &H, records: &[R]) -> bool {
        header.records() == count(records) && header.checksum() == self.checksum(header, records)
    }
}

/// Records of a slice; fleets are far smaller than the largest number.
fn count<R>(records: &[R]) -> u32 {
    u32::try_from(records.len()).unwrap_or(u32::MAX)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::{RobotCommand, RobotObservation, RobotState};
    use bytemuck::{bytes_of_mut, cast_slice_mut};

    const NAME: &str = "clearway/default/v1/state";

    /// Eight records whose bytes are all different from zero.
    fn sealed<H: Header, R: Pod>(name: &str) -> (H, [R; 8]) {
        let (mut header, mut records) = (H::default(), [R::zeroed(); 8]);
        let bytes = bytes_of_mut(&mut header).iter_mut().chain(cast_slice_mut(&mut records));
        bytes.zip((1..=u8::MAX).cycle()).for_each(|(byte, value)| *byte = value);
        Seal::of(name).put(&mut header, &records);
        (header, records)
    }

    /// Every bit of a sample, one at a time: all of them are found. Returns how many.
    fn every_flip_is_found<H: Header, R: Pod>(name: &str) -> usize {
        let (seal, (mut header, mut records)) = (Seal::of(name), sealed::<H, R>(name));
        assert!(seal.holds(&header, &records));
        for bit in 0..8 * size_of::<H>() {
            bytes_of_mut(&mut header)[bit / 8] ^= 1 << (bit % 8);
            assert!(!seal.holds(&header, &records), "bit {bit} of the header");
            bytes_of_mut(&mut header)[bit / 8] ^= 1 << (bit % 8);
        }
        for bit in 0..8 * size_of_val(&records) {
            cast_slice_mut::<R, u8>(&mut records)[bit / 8] ^= 1 << (bit % 8);
            assert!(!seal.holds(&header, &records), "bit {bit} of the records");
            cast_slice_mut::<R, u8>(&mut records)[bit / 8] ^= 1 << (bit % 8);
        }
        assert!(seal.holds(&header, &records));
        8 * (size_of::<H>() + size_of_val(&records))
    }

    #[test]
    fn every_flipped_bit_is_found() {
        assert_eq!(every_flip_is_found::<ObservationHeader, RobotObservation>(NAME), 8 * (32 + 8 * 32));
        assert_eq!(every_flip_is_found::<StateHeader, RobotState>(NAME), 8 * (48 + 8 * 168));
        assert_eq!(every_flip_is_found::<CommandHeader, RobotCommand>(NAME), 8 * (64 + 8 * 24));
    }

    #[test]
    fn every_burst_within_two_bytes_is_found() {
        let (seal, (header, mut records)) = (Seal::of(NAME), sealed::<StateHeader, RobotState>(NAME));
        for at in (0..size_of_val(&records) - 1).step_by(37) {
            for pattern in 1..=u16::MAX {
                let [low, high] = pattern.to_le_bytes();
                let mut flip = |pattern: [u8; 2]| {
                    let bytes = cast_slice_mut::<RobotState, u8>(&mut records);
                    (bytes[at], bytes[at + 1]) = (bytes[at] ^ pattern[0], bytes[at + 1] ^ pattern[1]);
                };
                flip([low, high]);
                assert!(!seal.holds(&header, &records));
                let bytes = cast_slice_mut::<RobotState, u8>(&mut records);
                (bytes[at], bytes[at + 1]) = (bytes[at] ^ low, bytes[at + 1] ^ high);
            }
        }
    }

    /// Sizes around those of a block.
    #[test]
    fn what_is_filled_in_blocks_is_sealed_as_a_whole() {
        let (seal, per_block) = (Seal::of(NAME), BLOCK_BYTES / size_of::<RobotCommand>());
        let filled = |n: u32| RobotCommand { id: n, v_mps: f64::from(n), ..RobotCommand::default() };
        for robots in [0, 1, per_block - 1, per_block, per_block + 1, 3 * per_block + 7] {
            let mut records = vec![RobotCommand::default(); robots];
            let mut header = CommandHeader { tick: 5, checksum: 9, records: 3, ..CommandHeader::default() };
            seal.put_in_blocks(&mut header, &mut records, |first, block| {
                let first = u32::try_from(first).unwrap();
                (first..).zip(block).for_each(|(n, record)| *record = filled(n));
            });
            let whole: Vec<_> = (0..u32::try_from(robots).unwrap()).map(filled).collect();
            assert_eq!(records, whole);
            let mut expected = CommandHeader { tick: 5, ..CommandHeader::default() };
            seal.put(&mut expected, &whole);
            assert_eq!(header, expected);
        }
    }

    /// A sample that is longer, shorter, of another channel, or of another fleet.
    #[test]
    fn only_the_whole_sample_of_the_right_channel_and_fleet_holds() {
        let (header, records) = sealed::<CommandHeader, RobotCommand>("clearway/default/v1/command");
        assert!(Seal::of("clearway/default/v1/command").holds(&header, &records));
        for other in ["clearway/default/v1/state", "clearway/other/v1/command", ""] {
            assert!(!Seal::of(other).holds(&header, &records), "{other:?}");
        }
        let seal = Seal::of("clearway/default/v1/command");
        assert!(!seal.holds(&header, &records[..7]) && !seal.holds(&header, &records[1..]));
        assert!(!seal.holds(&header, &[records, records].concat()));
        assert!(!seal.holds(&CommandHeader { records: 7, ..header }, &records[..7]));
        // Memory that nobody has written.
        assert!(!seal.holds(&CommandHeader::default(), &records[..0]));
        let (mut empty, none) = (CommandHeader::default(), &records[..0]);
        seal.put(&mut empty, none);
        assert!(seal.holds(&empty, none));
    }

    /// What everybody else computes: the check value of the standard, and a sample by hand.
    #[test]
    fn it_is_the_crc_of_zlib() {
        assert_eq!(Seal::of("123456789"), Seal { seed: 0xcbf4_3926 });
        let mut header = ObservationHeader { epoch: 1, sequence: 2, stamp_ns: 3, ..Default::default() };
        let record = RobotObservation { id: 7, x_m: 1.5, y_m: -2.0, theta_rad: 0.25, ..Default::default() };
        let name = "clearway/default/v1/observation";
        Seal::of(name).put(&mut header, &[record]);
        let mut bytes = name.as_bytes().to_vec();
        bytes.extend([1_u64, 2, 3].iter().flat_map(|word| word.to_le_bytes()));
        bytes.extend(1_u32.to_le_bytes());
        bytes.extend([7_u32, 0].iter().flat_map(|word| word.to_le_bytes()));
        bytes.extend([1.5_f64, -2.0, 0.25].iter().flat_map(|word| word.to_le_bytes()));
        assert_eq!(header.checksum, crc32fast::hash(&bytes));
        // docs/CHANNELS.md has the same number.
        assert_eq!((header.records, header.checksum), (1, 0x32e4_1e2e));
    }
}
