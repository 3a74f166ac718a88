use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};

use clearway::channel::Census;
use clearway::config::Config;

use super::examination::{Examination, Live};
use super::finding::{Finding, Status};
use super::{Diagnosis, print};
use crate::host::Host;

/// A machine that nobody could complain about.
const GOOD: &[(&str, &str)] = &[
    (
        "proc/self/limits",
        "Limit Soft Hard Units\nMax open files 20000 20000 files\nMax locked memory unlimited unlimited bytes\nMax realtime priority 99 99\n",
    ),
    ("proc/self/status", "Name:\tclearway\nCapEff:\t0000000000000000\nCpus_allowed_list:\t0-3\n"),
    ("proc/self/cgroup", "0::/fleet/daemon\n"),
    ("proc/sys/kernel/sched_rt_runtime_us", "-1\n"),
    ("proc/sys/kernel/sched_rt_period_us", "1000000\n"),
    ("proc/version", "Linux version 6.12.0-rt (gcc) #1 SMP PREEMPT_RT\n"),
    ("proc/cpuinfo", "processor : 0\nflags : fpu tsc constant_tsc\n"),
    ("proc/stat", "cpu 100 0 100 800 0 0 0 0 0 0\n"),
    ("proc/loadavg", "0.30 0.20 0.10 1/100 1234\n"),
    ("proc/swaps", "Filename Type Size Used Priority\n"),
    ("proc/mounts", "proc /proc proc rw 0 0\ntmpfs /dev/shm tmpfs rw,nosuid 0 0\n"),
    ("sys/fs/cgroup/fleet/daemon/cpu.max", "max 100000\n"),
    ("sys/kernel/realtime", "1\n"),
    ("sys/kernel/mm/transparent_hugepage/enabled", "always [madvise] never\n"),
    ("sys/devices/system/clocksource/clocksource0/current_clocksource", "tsc\n"),
    ("sys/devices/system/cpu/isolated", "3\n"),
    ("sys/devices/system/cpu/nohz_full", "3\n"),
    ("sys/devices/system/cpu/smt/active", "0\n"),
    ("sys/devices/system/cpu/cpu0/cpufreq/scaling_governor", "performance\n"),
    ("sys/devices/system/cpu/cpu0/cpuidle/state0/latency", "2\n"),
    ("sys/devices/system/cpu/cpu0/cpuidle/state0/name", "C1\n"),
    ("tmp/iceoryx2/keep", ""),
];

/// Files below a directory of its own.
struct Tree(PathBuf);

impl Tree {
    fn good() -> Self {
        static NEXT: AtomicU32 = AtomicU32::new(0);
        let name = format!("clearway_doctor_{}_{}", std::process::id(), NEXT.fetch_add(1, Ordering::Relaxed));
        let tree = Self(std::env::temp_dir().join(name));
        for (path, text) in GOOD {
            tree.write(path, text);
        }
        tree
    }

    fn write(&self, path: &str, text: &str) {
        let path = self.0.join(path);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, text).unwrap();
    }

    fn remove(&self, path: &str) {
        std::fs::remove_file(self.0.join(path)).unwrap();
    }

    fn examination(&self, config: Option<Config>) -> Examination {
        Examination::new(Host::at(&self.0), config, false)
    }

    fn diagnosis(&self) -> Diagnosis {
        Diagnosis::of(&self.examination(None))
    }
}

impl Drop for Tree {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

fn finding(diagnosis: &Diagnosis, name: &str) -> Finding {
    let found = diagnosis.findings.iter().find(|finding| finding.name == name);
    found.unwrap_or_else(|| panic!("no finding {name}")).clone()
}

fn live() -> Live {
    Live {
        fifo: Ok(()),
        shared_memory: Some((8 << 30, 8 << 30)),
        may_stay_awake: true,
        timer_step_ns: 1,
        census: Ok(Census { alive: 2, ..Census::default() }),
    }
}

/// A configuration, given by lines of TOML behind its scenario.
fn config(lines: &str) -> Config {
    Config::parse(&format!("schema = 1\nscenario = \"swap8\"\n{lines}"), "fleet.toml").unwrap()
}

#[test]
fn an_idle_state_that_the_daemon_keeps_cpus_out_of_is_no_trouble() {
    let tree = Tree::good();
    tree.write("sys/devices/system/cpu/cpu0/cpuidle/state1/latency", "170\n");
    let status = |lines: &str, may_stay_awake| {
        let mut e = tree.examination(Some(config(lines)));
        e.live = Some(Live { may_stay_awake, ..live() });
        finding(&Diagnosis::of(&e), "idle_states").status
    };
    assert_eq!(status("", true), Status::Ok);
    assert_eq!(status("", false), Status::Warn);
    assert_eq!(status("[realtime]\nstay_awake = false", true), Status::Warn);
}

#[test]
fn a_good_machine_has_nothing_to_complain_about() {
    let tree = Tree::good();
    let mut e = tree
        .examination(Some(config("[realtime]\npolicy = \"require\"\nloop_cpu = 3\nworker_cpus = [0, 1]")));
    e.live = Some(live());
    let diagnosis = Diagnosis::of(&e);
    let complaints: Vec<_> = diagnosis.findings.iter().filter(|f| f.status != Status::Ok).collect();
    assert!(complaints.is_empty(), "{complaints:?}");
    assert_eq!((diagnosis.exit_code, diagnosis.ok), (0, diagnosis.findings.len()));
}

/// A finding, the file that shows a bad state of it, its status then, and a word of the remedy.
type Bad = (&'static str, &'static str, String, Status, &'static str);

#[allow(clippy::too_many_lines, reason = "a table")]
fn bad_states() -> Vec<Bad> {
    const LIMITS: &str = "proc/self/limits";
    const STATUS: &str = "proc/self/status";
    let limits = |files, memory, priority| {
        format!(
            "Max open files {files} 20000 files\nMax locked memory {memory} unlimited bytes\nMax realtime priority {priority} 99\n"
        )
    };
    // state, ppid … tpgid, flags, up to 39, rt_priority, policy; proc(5).
    let audio = format!("7 (audio) S {}64 {}90 1 0 0", "0 ".repeat(5), "0 ".repeat(30));
    vec![
        ("scheduling", LIMITS, limits(20000, "unlimited", 0), Status::Fail, "LimitRTPRIO=80"),
        ("memlock", LIMITS, limits(20000, "8388608", 99), Status::Fail, "LimitMEMLOCK=infinity"),
        ("open_files", LIMITS, limits(256, "unlimited", 99), Status::Warn, "LimitNOFILE=1024"),
        ("cpus", STATUS, "Cpus_allowed_list:\t2\n".into(), Status::Warn, "cpuset"),
        (
            "rt_throttling",
            "proc/sys/kernel/sched_rt_runtime_us",
            "950000".into(),
            Status::Warn,
            "sched_rt_runtime_us=-1",
        ),
        (
            "rt_throttling",
            "proc/sys/kernel/sched_rt_runtime_us",
            "0".into(),
            Status::Fail,
            "sched_rt_runtime_us=950000",
        ),
        (
            "cpu_quota",
            "sys/fs/cgroup/fleet/daemon/cpu.max",
            "150000 100000".into(),
            Status::Warn,
            "--cpuset-cpus",
        ),
        ("cpu_quota", "sys/fs/cgroup/fleet/cpu.max", "50000 100000".into(), Status::Warn, "CPUQuota="),
        ("other_real_time", "proc/7/task/7/stat", audio, Status::Warn, "above 90"),
        (
            "isolated_cpus",
            "sys/devices/system/cpu/isolated",
            "\n".into(),
            Status::Warn,
            "isolcpus=managed_irq,domain,3",
        ),
        (
            "nohz_full",
            "sys/devices/system/cpu/nohz_full",
            "(null)\n".into(),
            Status::Warn,
            "nohz_full=3 rcu_nocbs=3",
        ),
        (
            "governor",
            "sys/devices/system/cpu/cpu1/cpufreq/scaling_governor",
            "powersave\n".into(),
            Status::Warn,
            "cpupower frequency-set -g performance",
        ),
        (
            "idle_states",
            "sys/devices/system/cpu/cpu0/cpuidle/state1/latency",
            "170\n".into(),
            Status::Warn,
            "cpupower idle-set -D 20",
        ),
        ("smt", "sys/devices/system/cpu/smt/active", "1\n".into(), Status::Warn, "smt/control"),
        (
            "clock_source",
            "sys/devices/system/clocksource/clocksource0/current_clocksource",
            "hpet\n".into(),
            Status::Warn,
            "clocksource=tsc",
        ),
        ("machine", "proc/cpuinfo", "flags : fpu hypervisor\n".into(), Status::Warn, "hardware of your own"),
        (
            "machine",
            "sys/class/dmi/id/product_name",
            "VMware Virtual Platform\n".into(),
            Status::Warn,
            "pin the virtual CPUs",
        ),
        (
            "thp",
            "sys/kernel/mm/transparent_hugepage/enabled",
            "[always] madvise never\n".into(),
            Status::Warn,
            "echo madvise",
        ),
        (
            "swap",
            "proc/swaps",
            "Filename Type Size Used Priority\n/dev/sda2 partition 1 0 -2\n".into(),
            Status::Warn,
            "swapoff -a",
        ),
        ("load", "proc/loadavg", "9.00 1.0 1.0 1/1 1\n".into(), Status::Warn, "top"),
        ("shared_memory", "proc/mounts", "proc /proc proc rw 0 0\n".into(), Status::Fail, "mount -t tmpfs"),
        ("shared_memory", "proc/mounts", "tmpfs /dev/shm tmpfs ro 0 0\n".into(), Status::Fail, "mode=1777"),
    ]
}

/// Each finding in each of its bad states: the file that shows it, and what is said.
#[test]
fn every_bad_state_is_found_and_has_a_remedy() {
    for (name, path, text, status, remedy) in bad_states() {
        let tree = Tree::good();
        assert_eq!(finding_or_ok(&tree, name), Status::Ok, "{name} before");
        tree.write(path, &text);
        let diagnosis = tree.diagnosis();
        let found = finding(&diagnosis, name);
        assert_eq!(found.status, status, "{found:?}");
        assert!(found.remedy.contains(remedy), "{found:?}");
        assert!(!found.why.is_empty() && !found.value.is_empty(), "{found:?}");
        assert_eq!(diagnosis.exit_code, u8::from(status == Status::Fail), "{name}");
    }
}

/// Some findings are there only where the kernel has the feature.
fn finding_or_ok(tree: &Tree, name: &str) -> Status {
    tree.diagnosis()
        .findings
        .iter()
        .find(|finding| finding.name == name)
        .map_or(Status::Ok, |found| found.status)
}

#[test]
fn control_groups_of_version_1_are_read_too() {
    let tree = Tree::good();
    tree.write("proc/self/cgroup", "3:cpuset:/\n2:cpu,cpuacct:/docker/abc\n");
    tree.write("sys/fs/cgroup/cpu/docker/abc/cpu.cfs_quota_us", "-1\n");
    tree.write("sys/fs/cgroup/cpu/docker/abc/cpu.cfs_period_us", "100000\n");
    tree.write("sys/fs/cgroup/cpu/docker/abc/cpu.rt_runtime_us", "950000\n");
    let good = tree.diagnosis();
    assert_eq!([finding(&good, "cpu_quota").status, finding(&good, "rt_group").status], [Status::Ok; 2]);
    tree.write("sys/fs/cgroup/cpu/docker/abc/cpu.cfs_quota_us", "50000\n");
    tree.write("sys/fs/cgroup/cpu/docker/abc/cpu.rt_runtime_us", "0\n");
    let bad = tree.diagnosis();
    assert_eq!(finding(&bad, "cpu_quota").value, "0.50 CPUs");
    assert_eq!(finding(&bad, "rt_group").status, Status::Fail);
}

#[test]
fn preemption_models_are_told_apart() {
    let tree = Tree::good();
    tree.remove("sys/kernel/realtime");
    for (version, status, value) in [
        ("Linux version 6.1 #1 SMP PREEMPT_RT", Status::Ok, "PREEMPT_RT"),
        ("Linux version 6.1 #1 SMP PREEMPT_DYNAMIC", Status::Warn, "dynamic"),
        ("Linux version 6.1 #1 SMP PREEMPT", Status::Warn, "preemptible"),
        ("Linux version 6.1 #1 SMP", Status::Warn, "none"),
    ] {
        tree.write("proc/version", version);
        let found = finding(&tree.diagnosis(), "preemption");
        assert!(found.status == status && found.value.contains(value), "{found:?}");
    }
    tree.write("proc/version", "Linux version 6.1 #1 SMP PREEMPT_DYNAMIC");
    tree.write("sys/kernel/debug/sched/preempt", "none (voluntary) full\n");
    assert_eq!(finding(&tree.diagnosis(), "preemption").value, "dynamic, voluntary");
}

#[test]
fn capabilities_stand_above_limits() {
    let tree = Tree::good();
    tree.write(
        "proc/self/limits",
        "Max open files 2000 2000 files\nMax locked memory 0 0 bytes\nMax realtime priority 0 0\n",
    );
    let refused = tree.diagnosis();
    assert_eq!((refused.failures, refused.exit_code), (2, 1));
    // CAP_IPC_LOCK is bit 14 and CAP_SYS_NICE bit 23.
    tree.write("proc/self/status", "CapEff:\t0000000000804000\nCpus_allowed_list:\t0-3\n");
    assert_eq!(tree.diagnosis().failures, 0);
}

#[test]
fn what_only_the_running_kernel_knows() {
    let tree = Tree::good();
    let with = |change: &dyn Fn(&mut Live)| {
        let (mut e, mut live) = (tree.examination(None), live());
        change(&mut live);
        e.live = Some(live);
        Diagnosis::of(&e)
    };
    let refused = with(&|live| live.fifo = Err("Operation not permitted".into()));
    assert!(finding(&refused, "scheduling").value.contains("not permitted"));
    assert_eq!(refused.exit_code, 1);

    let coarse = with(&|live| live.timer_step_ns = 4_000_000);
    assert!(finding(&coarse, "timers").status == Status::Fail && coarse.exit_code == 1);

    let needed = tree.examination(None).needed_bytes.unwrap();
    let room =
        |free| finding(&with(&|live| live.shared_memory = Some((free, 64 << 20))), "shared_memory_room");
    assert_eq!(
        [needed - 1, 2 * needed - 1, 2 * needed].map(|free| room(free).status),
        [Status::Fail, Status::Warn, Status::Ok]
    );
    assert!(room(0).remedy.contains("remount,size="));

    let dead = with(&|live| live.census = Ok(Census { alive: 1, dead: 3, unclear: 0 }));
    let found = finding(&dead, "left_over_nodes");
    assert!(found.status == Status::Warn && found.value.starts_with('3'), "{found:?}");
    let unclear = with(&|live| live.census = Ok(Census { alive: 0, dead: 0, unclear: 1 }));
    assert_eq!(finding(&unclear, "left_over_nodes").status, Status::Warn);
    let unread = with(&|live| live.census = Err("no access".into()));
    assert!(finding(&unread, "left_over_nodes").status == Status::Unknown && unread.exit_code == 2);
}

#[test]
fn a_tree_without_files_is_not_examined_rather_than_good() {
    let tree = Tree(std::env::temp_dir().join(format!("clearway_doctor_none_{}", std::process::id())));
    let diagnosis = tree.diagnosis();
    assert!(diagnosis.unknown > 5, "{}", diagnosis.unknown);
    // The directory for the channels can not be made either, and a failure outranks.
    assert_eq!(finding(&diagnosis, "channel_directory").status, Status::Fail);
    std::fs::create_dir_all(tree.0.join("tmp")).unwrap();
    assert_eq!(tree.diagnosis().exit_code, 2);
}

#[test]
fn a_directory_that_nobody_may_write_is_a_failure() {
    let tree = Tree::good();
    let directory = tree.0.join("tmp/iceoryx2");
    let mode = |mode| std::fs::set_permissions(&directory, std::fs::Permissions::from_mode(mode)).unwrap();
    mode(0o555);
    let found = finding(&tree.diagnosis(), "channel_directory");
    mode(0o755);
    assert_eq!(found.status, Status::Fail);
    assert!(found.remedy.contains("mkdir -p /tmp/iceoryx2"), "{found:?}");
}

#[test]
fn a_configuration_is_held_against_the_host() {
    let tree = Tree::good();
    let of = |lines: &str, name: &str| finding(&Diagnosis::of(&tree.examination(Some(config(lines)))), name);
    for (lines, name, status, remedy) in [
        ("[realtime]\npolicy = \"off\"", "config_policy", Status::Warn, "require"),
        ("[realtime]\nloop_cpu = 9", "config_cpus", Status::Fail, "0, 1, 2, 3"),
        ("[realtime]\nworker_cpus = [1, 7]", "config_cpus", Status::Fail, "0, 1, 2, 3"),
        ("[realtime]\npriority = 99", "config_priority", Status::Warn, "80"),
        ("[realtime]\npriority = 40", "config_priority", Status::Warn, "80"),
        ("[timing]\nworkers = 8", "config_workers", Status::Warn, "timing.workers = 4"),
        (
            "[realtime]\nloop_cpu = 3\nworker_cpus = [3]\n[timing]\nworkers = 1",
            "config_workers",
            Status::Warn,
            "worker_cpus",
        ),
        ("[realtime]\nloop_cpu = 1", "isolated_cpus", Status::Warn, "isolcpus=managed_irq,domain,1"),
    ] {
        let found = of(lines, name);
        assert!(found.status == status && found.remedy.contains(remedy), "{lines}: {found:?}");
    }
    assert_eq!(of("[timing]\nperiod_us = 500", "config_period").status, Status::Ok);
    tree.write("proc/cpuinfo", "flags : hypervisor\n");
    assert_eq!(of("[timing]\nperiod_us = 500", "config_period").status, Status::Warn);
    assert_eq!(of("[timing]\nperiod_us = 80000", "config_period").status, Status::Ok);
}

#[test]
fn eighty_columns_hold_every_line() {
    let tree = Tree::good();
    for (path, _) in GOOD {
        if *path != "proc/self/cgroup" && Path::new(path).starts_with("proc") {
            tree.remove(path);
        }
    }
    tree.write("proc/swaps", "head\na\n");
    tree.write("sys/devices/system/cpu/isolated", "\n");
    tree.write("sys/devices/system/cpu/smt/active", "1\n");
    let text = print::text(&tree.diagnosis());
    assert!(text.lines().all(|line| line.chars().count() <= 80 && line == line.trim_end()), "{text}");
    assert!(text.contains("not examined") && text.contains('→'), "{text}");
}
