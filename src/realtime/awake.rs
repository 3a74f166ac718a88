use std::fs::{File, OpenOptions};
use std::io::Write;
use std::path::Path;

use crate::config::{RealTimeConfig, RealTimePolicy};

/// What the kernel asks how long a CPU may take to wake up.
const DEVICE: &str = "/dev/cpu_dma_latency";
/// Where a CPU lists the idle states that it may be put into.
const IDLE_STATES: &str = "/sys/devices/system/cpu/cpu0/cpuidle";

/// While it is held no CPU of the machine is put into an idle state that takes time to leave.
#[derive(Debug)]
pub struct Awake(
    #[expect(dead_code, reason = "the kernel takes the wish back when the file is closed")] File,
);

/// Keeps the CPUs out of idle states, by holding `/dev/cpu_dma_latency` at 0 µs.
///
/// `Ok(None)` when it was not asked for, or when this machine chooses no idle states.
///
/// # Errors
/// Why it was refused, and what to change.
pub fn stay_awake(config: &RealTimeConfig) -> Result<Option<Awake>, String> {
    if config.policy == RealTimePolicy::Off || !config.stay_awake {
        return Ok(None);
    }
    hold(Path::new(DEVICE), Path::new(IDLE_STATES))
}

fn hold(device: &Path, idle_states: &Path) -> Result<Option<Awake>, String> {
    if !idle_states.exists() {
        return Ok(None);
    }
    let held = OpenOptions::new().write(true).open(device).and_then(|mut file| {
        file.write_all(&0_i32.to_ne_bytes())?;
        Ok(file)
    });
    held.map(|file| Some(Awake(file))).map_err(|e| {
        format!(
            "CPUs may sleep deeply between periods: {} is not held: {e}; give the daemon write access to it (udev: \
             KERNEL==\"cpu_dma_latency\", GROUP=\"realtime\", MODE=\"0660\"), or set realtime.stay_awake = false",
            device.display()
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_is_held_unless_asked() {
        let off = RealTimeConfig { policy: RealTimePolicy::Off, ..RealTimeConfig::default() };
        let no = RealTimeConfig { stay_awake: false, ..RealTimeConfig::default() };
        for config in [off, no] {
            assert!(stay_awake(&config).is_ok_and(|held| held.is_none()));
        }
    }

    #[test]
    fn the_device_is_told_zero_where_there_are_idle_states_and_a_refusal_says_what_to_change() {
        let folder = std::env::temp_dir().join(format!("clearway_awake_{}", std::process::id()));
        let (device, states) = (folder.join("device"), folder.join("cpuidle"));
        std::fs::create_dir_all(&folder).unwrap();
        assert!(hold(&device, &states).unwrap().is_none());
        std::fs::create_dir(&states).unwrap();
        let refused = hold(&device, &states).unwrap_err();
        assert!(
            refused.contains("device is not held") && refused.contains("realtime.stay_awake"),
            "{refused}"
        );
        std::fs::write(&device, "").unwrap();
        assert!(hold(&device, &states).unwrap().is_some());
        assert_eq!(std::fs::read(&device).unwrap(), [0; 4]);
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
