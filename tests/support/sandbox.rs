//! Machines that are worse than this one: with little shared memory, without rights, with another clock, with
//! little time. Each says so where it cannot be had.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use super::process::skipped;

/// `command`, run by `wrapper`.
pub fn wrapped(command: &Command, wrapper: &[&str]) -> Command {
    let mut outer = Command::new(wrapper[0]);
    outer.args(&wrapper[1..]).arg(command.get_program()).args(command.get_args());
    for (name, value) in command.get_envs() {
        if let Some(value) = value {
            outer.env(name, value);
        }
    }
    if let Some(folder) = command.get_current_dir() {
        outer.current_dir(folder);
    }
    outer.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    outer
}

/// Whether `wrapper` runs a program here; otherwise says that `test` is skipped.
fn works(test: &str, wrapper: &[&str], what: &str) -> bool {
    let run = wrapped(&Command::new("true"), wrapper).output();
    let reason = match run {
        Ok(output) if output.status.success() => return true,
        Ok(output) => String::from_utf8_lossy(&output.stderr).trim().to_owned(),
        Err(e) => format!("{}: {e}", wrapper[0]),
    };
    skipped(test, &format!("{what} cannot be had here: {reason}"));
    false
}

/// `command` with a `/dev/shm` of its own, of `size`.
pub fn small_shared_memory(test: &str, command: &Command, size: &str) -> Option<Command> {
    let script = "mount -t tmpfs -o size=\"$1\" tmpfs /dev/shm && shift && exec \"$@\"";
    let wrapper = ["unshare", "--mount", "sh", "-c", script, "sh", size];
    works(test, &wrapper, "shared memory of its own").then(|| wrapped(command, &wrapper))
}

/// `command` in the mounts of the process `id`.
pub fn beside(id: u32, command: &Command) -> Command {
    let namespace = format!("--mount=/proc/{id}/ns/mnt");
    // Entering moves to the root directory.
    let there = format!("--wd={}", command.get_current_dir().unwrap_or(Path::new("/")).display());
    wrapped(command, &["nsenter", &namespace, &there])
}

/// `command` without the right to real-time scheduling and to locked memory.
pub fn without_rights(test: &str, command: &Command) -> Option<Command> {
    let limits = "ulimit -l 64 && ulimit -r 0 && exec \"$@\"";
    let limited = ["bash", "-c", limits, "bash"];
    let dropped = [
        &["setpriv", "--bounding-set", "-sys_nice,-ipc_lock", "--inh-caps", "-sys_nice,-ipc_lock"][..],
        &limited[..],
    ]
    .concat();
    // Whoever is not root has no such rights beyond the limits.
    let wrapper = if rustix::process::geteuid().is_root() { &dropped[..] } else { &limited[..] };
    works(test, wrapper, "a process without rights").then(|| wrapped(command, wrapper))
}

/// `command` with a monotonic clock that is `offset_s` ahead of everybody else's.
pub fn other_clock(test: &str, command: &Command, offset_s: i64) -> Option<Command> {
    let offset = offset_s.to_string();
    let wrapper = ["unshare", "--fork", "--kill-child", "--time", "--monotonic", &offset];
    works(test, &wrapper, "a clock of its own").then(|| wrapped(command, &wrapper))
}

/// A group of processes that get a share of one CPU.
pub struct Quota(PathBuf);

impl Quota {
    /// `run_us` of every `period_us`.
    pub fn new(test: &str, name: &str, run_us: u64, period_us: u64) -> Option<Self> {
        let made =
            [Path::new("/sys/fs/cgroup/cpu"), Path::new("/sys/fs/cgroup")].into_iter().find_map(|root| {
                let old = root.join("cpu.cfs_quota_us").exists();
                if !old && !root.join("cgroup.controllers").exists() {
                    return None;
                }
                let quota = Self(root.join(name));
                std::fs::create_dir(&quota.0).ok()?;
                let set = |file: &str, text: String| std::fs::write(quota.0.join(file), text).ok();
                if old {
                    set("cpu.cfs_period_us", period_us.to_string())?;
                    set("cpu.cfs_quota_us", run_us.to_string())?;
                } else {
                    set("cpu.max", format!("{run_us} {period_us}"))?;
                }
                Some(quota)
            });
        if made.is_none() {
            skipped(test, "no group of processes with a share of the CPU can be made here");
        }
        made
    }

    /// Puts a process and all its threads into the group.
    pub fn takes(&self, id: u32) {
        std::fs::write(self.0.join("cgroup.procs"), id.to_string()).unwrap();
    }

    /// Lets the group run as much as it likes again.
    pub fn lift(&self) {
        let (old, new) = (self.0.join("cpu.cfs_quota_us"), self.0.join("cpu.max"));
        let lifted = if old.exists() { std::fs::write(old, "-1") } else { std::fs::write(new, "max") };
        lifted.unwrap();
    }

    /// How often the group has had to wait for its next share.
    pub fn throttled(&self) -> u64 {
        let text = std::fs::read_to_string(self.0.join("cpu.stat")).unwrap();
        let line = text.lines().find_map(|line| line.strip_prefix("nr_throttled "));
        line.unwrap().trim().parse().unwrap()
    }
}

impl Drop for Quota {
    fn drop(&mut self) {
        // It goes once its processes are gone; those that were killed take a moment.
        for _ in 0..500 {
            if std::fs::remove_dir(&self.0).is_ok() {
                return;
            }
            std::thread::sleep(std::time::Duration::from_millis(2));
        }
    }
}

/// Compiles a library that sets the wall clock of a process forward and back by `step_s` at every look.
/// Control is built with a C compiler, so there is one.
pub fn jumping_wall_clock(folder: &Path, step_s: i64) -> PathBuf {
    let source = format!(
        "#define _GNU_SOURCE\n#include <dlfcn.h>\n#include <stdatomic.h>\n#include <sys/time.h>\n#include <time.h>\n\
         static atomic_int looks;\n\
         static long step(void) {{ return atomic_fetch_add(&looks, 1) % 2 ? {step_s} : -{step_s}; }}\n\
         int clock_gettime(clockid_t id, struct timespec *now) {{\n\
         \tint (*real)(clockid_t, struct timespec *) = dlsym(RTLD_NEXT, \"clock_gettime\");\n\
         \tint result = real(id, now);\n\
         \tif (id == CLOCK_REALTIME || id == CLOCK_REALTIME_COARSE) now->tv_sec += step();\n\
         \treturn result;\n}}\n\
         time_t time(time_t *out) {{\n\
         \tstruct timespec now; clock_gettime(CLOCK_REALTIME, &now);\n\
         \tif (out) *out = now.tv_sec;\n\treturn now.tv_sec;\n}}\n\
         int gettimeofday(struct timeval *restrict out, void *restrict zone) {{\n\
         \t(void)zone; struct timespec now; clock_gettime(CLOCK_REALTIME, &now);\n\
         \tout->tv_sec = now.tv_sec; out->tv_usec = now.tv_nsec / 1000;\n\treturn 0;\n}}\n"
    );
    std::fs::create_dir_all(folder).unwrap();
    let (input, library) = (folder.join("jumping.c"), folder.join("jumping.so"));
    std::fs::write(&input, source).unwrap();
    let built = Command::new("cc").args(["-shared", "-fPIC", "-O1", "-o"]).arg(&library).arg(&input).output();
    let built = built.unwrap();
    assert!(built.status.success(), "{}", String::from_utf8_lossy(&built.stderr));
    library
}
