//! `clearway record` and `clearway replay` as processes beside a running daemon.

#[path = "recording/mod.rs"]
mod recording;
#[path = "../../../tests/support/mod.rs"]
mod support;

use std::path::{Path, PathBuf};
use std::process::Command;

use clearway::channel::{CommandReader, StateReader, Transport};
use clearway::config::Config;
use clearway::controller::Timing;
use clearway::evaluation;
use clearway::runtime::{Daemon, Until};
use clearway::scenario::Scenario;
use clearway_record::schema::clearway as proto;
use prost::Message;
use recording::{Recording, channel, clearway, drive, read_independently, replay, ticks};
use rustix::process::Signal;
use support::process::{isolated, skipped, until};
use support::{World, config};

/// Short, so that the tests are.
const PERIOD_NS: u64 = 5_000_000;

fn swap(world: &World) -> Config {
    let mut config = config(world, Scenario::builtin("swap8").unwrap(), PERIOD_NS);
    config.timing.workers = Some(2);
    config
}

fn file(world: &World, name: &str) -> PathBuf {
    std::fs::create_dir_all(&world.channel.root).unwrap();
    world.channel.root.join(name)
}

#[test]
fn a_whole_run_is_recorded_read_by_others_and_computed_again_to_the_bit() {
    let world = World::new("record");
    let (config, out) = (swap(&world), file(&world, "run.mcap"));
    let recorder = Recording::start(&world, &out, &["--once"]);
    let report = drive(&config, Until::Arrived);
    let (status, summary) = recorder.finish();
    assert_eq!(status, 0, "{summary:#}");
    assert_eq!(summary["complete"], true);
    for name in ["state", "telemetry", "checkpoint"] {
        let channel = channel(&summary, name);
        assert_eq!(channel["received"].as_u64(), Some(report.ticks), "{summary:#}");
        assert_eq!((&channel["missed"], &channel["ticks"][0]), (&0.into(), &0.into()));
    }
    assert_eq!(channel(&summary, "command")["ticks"][0], 0);

    let (status, result) = replay(&world, &[&out], &[]);
    assert_eq!(status, 0, "{result:#}");
    assert_eq!((&result["equal"], &result["configuration"]), (&true.into(), &"recording".into()));
    assert_eq!(result["periods"].as_u64(), Some(report.ticks));
    assert_eq!(result["missing_ticks"].as_u64(), Some(report.skipped_periods));
    let compared = result["compared_commands"].as_u64().unwrap();
    let outside: u64 = result["not_decided"].as_object().unwrap().values().map(|n| n.as_u64().unwrap()).sum();
    let late = result["too_late"].as_u64().unwrap();
    // The first command and the last answer no state.
    assert_eq!(compared + outside + 8 * late, 8 * (report.ticks + 2), "{result:#}");

    let Some(found) = read_independently(&out, &[]) else { return };
    let states = ticks(&found, "/clearway/state");
    assert_eq!(states.len() as u64, report.ticks);
    assert_eq!(*states.last().unwrap() + 1, report.ticks + report.skipped_periods);
    assert_eq!(ticks(&found, "/clearway/telemetry"), states);
    assert_eq!(ticks(&found, "/clearway/checkpoint"), states);
    let commands = channel(&summary, "command")["received"].as_u64().unwrap();
    assert_eq!(ticks(&found, "/clearway/command").len() as u64, commands);
    let schema = |topic: &str| found["schemas"][topic].clone();
    assert_eq!(schema("/fleet/poses"), serde_json::json!(["foxglove.PosesInFrame", "protobuf", "protobuf"]));
    assert_eq!(schema("/fleet/scene"), serde_json::json!(["foxglove.SceneUpdate", "protobuf", "protobuf"]));
    let twist = serde_json::json!(["geometry_msgs/msg/TwistStamped", "ros2msg", "cdr"]);
    assert_eq!(schema("/robot/7/twist"), twist);
    // The same pose in both standard types, near the goal of the scenario.
    let (poses, pose) = (&found["poses"][3], &found["robot_poses"]["/robot/3/pose"]);
    let goal = config.scenario.robots[3].goal_m;
    assert_eq!((&pose[0], &pose[1], &pose[2]), (&"world".into(), &poses[0], &poses[1]));
    assert!((poses[0].as_f64().unwrap() - goal.x).abs() < 0.2, "{poses}");
    assert_eq!(found["twists"]["/robot/3/twist"][0], "robot_3");
    assert_eq!(found["entities"][1].as_array().unwrap().len(), 16, "a body and a goal for each robot");
}

/// Until the daemon has driven `more` periods.
fn periods(states: &mut StateReader, more: u64) -> u64 {
    let newest = |states: &mut StateReader| states.newest().unwrap().map(|sample| sample.header().tick);
    let from = until(|| newest(states));
    until(|| newest(states).filter(|tick| *tick >= from + more))
}

fn endless(world: &World) -> (Daemon, StateReader) {
    let daemon = Daemon::start(swap(world), Until::Stopped).unwrap();
    let node = Transport::new("default", &world.channel).unwrap().attach("test").unwrap();
    let states = until(|| node.reader().ok());
    (daemon, states)
}

#[test]
fn a_killed_recorder_leaves_a_file_that_is_whole_up_to_its_last_chunk() {
    let world = World::new("killed");
    let out = file(&world, "run.mcap");
    let recorder = Recording::start(&world, &out, &["--flush-every", "20ms", "--chunk-size", "4KiB"]);
    let (daemon, mut states) = endless(&world);
    periods(&mut states, 100);
    recorder.signal(Signal::KILL);
    drop(recorder);
    // Control did not notice.
    periods(&mut states, 20);
    daemon.stop();
    assert_eq!(daemon.join().unwrap().ended_by, "operator");

    let (status, result) = replay(&world, &[&out], &[]);
    assert_eq!(status, 0, "{result:#}");
    assert_eq!(result["files"][0]["whole"], false);
    let compared = result["compared_periods"].as_u64().unwrap();
    assert!(compared > 0, "{result:#}");
    let Some(found) = read_independently(&out, &["--cut-off"]) else { return };
    let states = ticks(&found, "/clearway/state");
    assert_eq!(states.len() as u64, result["periods"].as_u64().unwrap());
    assert_eq!(states[0], 0);
}

#[test]
fn a_recorder_that_stands_still_loses_samples_and_control_none() {
    for attempt in 0..5 {
        let world = World::new("slow");
        let out = file(&world, "run.mcap");
        let mut config = swap(&world);
        config.timing.ticks = Some(350);
        let node = Transport::new("default", &world.channel).unwrap().attach("test").unwrap();
        let mut commands: CommandReader = node.reader_or_create(8).unwrap();
        let recorder = Recording::start(&world, &out, &["--once"]);
        let daemon = Daemon::start(config.clone(), Until::Stopped).unwrap();
        let mut sent = std::collections::BTreeMap::new();
        let mut stopped = false;
        until(|| {
            while let Some(sample) = commands.next().unwrap() {
                let bits = |c: &clearway::wire::RobotCommand| (c.v_mps.to_bits(), c.omega_radps.to_bits());
                sent.insert(sample.header().tick, sample.robots().iter().map(bits).collect::<Vec<_>>());
            }
            let tick = sent.last_key_value().map_or(0, |(tick, _)| *tick);
            if tick > 60 && !stopped {
                recorder.signal(Signal::STOP);
                stopped = true;
            }
            (tick >= 300 || daemon.is_finished()).then_some(())
        });
        recorder.signal(Signal::CONT);
        let report = daemon.join().unwrap();
        let (status, summary) = recorder.finish();
        assert_eq!(status, 1, "{summary:#}");
        for name in ["state", "telemetry", "checkpoint"] {
            let channel = channel(&summary, name);
            let (received, missed) =
                (channel["received"].as_u64().unwrap(), channel["missed"].as_u64().unwrap());
            assert!(missed > 0, "{name}: {summary:#}");
            if name != "state" || report.skipped_periods == 0 {
                assert!(received + missed >= report.ticks, "{name}: {summary:#}");
            }
        }
        // What was recorded computes again, before the gap and after it.
        let (status, result) = replay(&world, &[&out], &[]);
        assert_eq!(status, 0, "{result:#}");
        assert!(result["missing_ticks"].as_u64().unwrap() > 0);

        if report.deadline_misses + report.skipped_periods > 0 && attempt < 4 {
            continue; // the machine was busy: the commands of a run with misses are another run's
        }
        // The commands are those of the closed loop without any recorder, computed in virtual time.
        let mut expected = std::collections::BTreeMap::new();
        evaluation::run(&config, Timing::LogicalExecutionTime, |tick, fleet| {
            let bits = |r: &clearway::wire::RobotState| (r.v_mps.to_bits(), r.omega_radps.to_bits());
            expected.insert(tick, fleet.iter().map(bits).collect::<Vec<_>>());
        })
        .unwrap();
        let common: Vec<u64> =
            sent.keys().copied().filter(|tick| *tick < 300 && expected.contains_key(tick)).collect();
        assert!(common.len() > 100);
        assert!(common.iter().all(|tick| sent[tick] == expected[tick]));
        return;
    }
}

/// A small file system of its own for the recorder; `None`, and said so, without the privilege.
fn on_small_disk(world: &World, disk: &Path, more: &[&str]) -> Option<Command> {
    std::fs::create_dir_all(disk).unwrap();
    let probe = Command::new("unshare")
        .args(["--mount", "sh", "-c", "mount -t tmpfs -o size=1m tmpfs \"$1\"", "sh"])
        .arg(disk)
        .output();
    if !probe.as_ref().is_ok_and(|output| output.status.success()) {
        skipped("a full disk", &format!("no small file system of its own: {probe:?}"));
        return None;
    }
    let script = "mount -t tmpfs -o size=3m tmpfs \"$1\" && head -c 1M /dev/zero > \"$1/filler\" && shift && exec \"$@\"";
    let mut command = Command::new("unshare");
    command.args(["--mount", "sh", "-c", script, "sh"]).arg(disk);
    command.arg(env!("CARGO_BIN_EXE_clearway")).arg("record").arg(disk.join("run.mcap"));
    command.args(["--wait", "forever", "--json", "--once", "--compression", "none"]).args(more);
    isolated(&mut command, world);
    Some(command)
}

#[test]
fn a_full_disk_ends_the_file_in_order_and_recording_goes_on_when_there_is_room() {
    let world = World::new("full");
    let disk = file(&world, "disk");
    let Some(command) = on_small_disk(&world, &disk, &[]) else { return };
    let mut recorder = Recording::spawn(command);
    let (daemon, mut states) = endless(&world);
    recorder.line("NOT RECORDING");
    // Its file system is seen through the process.
    let inside = PathBuf::from(format!("/proc/{}/root{}", recorder.pid(), disk.display()));
    let (first, second) = (file(&world, "first.mcap"), file(&world, "second.mcap"));
    std::fs::copy(inside.join("run.mcap"), &first).unwrap();
    periods(&mut states, 20);
    std::fs::remove_file(inside.join("filler")).unwrap();
    recorder.line("recording again");
    periods(&mut states, 100);
    recorder.signal(Signal::STOP);
    std::fs::copy(inside.join("run-0001.mcap"), &second).unwrap();
    recorder.signal(Signal::CONT);
    daemon.stop();
    let report = daemon.join().unwrap();
    assert_eq!(report.ended_by, "operator");
    let (status, summary) = recorder.finish();
    assert_eq!(status, 1, "{summary:#}");
    assert!(summary["unrecorded"].as_u64().unwrap() > 0);
    assert_eq!(summary["dropped"], 0, "it went on counting what came: {summary:#}");

    let (status, result) = replay(&world, &[&first, &second], &[]);
    assert_eq!(status, 0, "{result:#}");
    assert_eq!(result["files"][0]["whole"], true, "{result:#}");
    assert!(result["missing_ticks"].as_u64().unwrap() > 0, "{result:#}");
    let Some(found) = read_independently(&first, &[]) else { return };
    assert!(found["chunks"].as_u64().unwrap() > 0);
    assert_eq!(ticks(&found, "/clearway/state")[0], 0);
}

#[test]
fn files_rotate_the_oldest_are_deleted_and_the_rest_computes_again() {
    let world = World::new("rotate");
    let out = file(&world, "run.mcap");
    let recorder = Recording::start(&world, &out, &["--once", "--max-size", "150KiB", "--keep", "3"]);
    drive(&swap(&world), Until::Arrived);
    let (status, summary) = recorder.finish();
    assert_eq!(status, 0, "{summary:#}");
    let files: Vec<PathBuf> =
        summary["files"].as_array().unwrap().iter().map(|f| f.as_str().unwrap().into()).collect();
    assert_eq!(files.len(), 3, "{summary:#}");
    assert!(!out.exists(), "the first was deleted");
    let files: Vec<&Path> = files.iter().map(PathBuf::as_path).collect();
    let (status, result) = replay(&world, &files, &[]);
    assert_eq!(status, 0, "{result:#}");
    assert!(result["files"].as_array().unwrap().iter().all(|file| file["whole"] == true));
    // It begins in the middle of the run, and every period but those at the edges is there.
    let (periods, compared) =
        (result["periods"].as_u64().unwrap(), result["compared_periods"].as_u64().unwrap());
    assert!(compared > 20 && periods - compared < 10, "{result:#}");
}

#[test]
fn a_daemon_that_is_started_again_is_recorded_on() {
    let world = World::new("again");
    let out = file(&world, "run.mcap");
    let mut recorder = Recording::start(&world, &out, &[]);
    let mut config = swap(&world);
    config.timing.ticks = Some(40);
    let first = drive(&config, Until::Stopped);
    recorder.line("is over");
    // Another fleet of another size: whoever stays attached must not stand in its way.
    config.scenario = Scenario::builtin("circle-12").unwrap();
    let second = drive(&config, Until::Stopped);
    recorder.line("is over");
    recorder.signal(Signal::TERM);
    let (status, summary) = recorder.finish();
    assert_eq!(status, 0, "{summary:#}");
    assert_eq!(summary["runs"].as_array().unwrap().len(), 2);
    let (status, result) = replay(&world, &[&out], &[]);
    assert_eq!(status, 0, "{result:#}");
    assert_eq!(result["epochs"], 2);
    assert_eq!(result["periods"].as_u64(), Some(first.ticks + second.ticks), "{result:#}");
}

/// Copies a recording and changes messages on the way.
fn edited(from: &Path, to: &Path, mut change: impl FnMut(&str, &mut Vec<u8>)) {
    let bytes = std::fs::read(from).unwrap();
    let mut writer = mcap::Writer::new(std::fs::File::create(to).unwrap()).unwrap();
    let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
    for index in &summary.attachment_indexes {
        writer.attach(&mcap::read::attachment(&bytes, index).unwrap()).unwrap();
    }
    for message in mcap::MessageStream::new(&bytes).unwrap() {
        let mut message = message.unwrap();
        let mut data = message.data.to_vec();
        change(&message.channel.topic, &mut data);
        message.data = data.into();
        writer.write(&message).unwrap();
    }
    writer.finish().unwrap();
}

#[test]
fn one_changed_bit_is_found_and_named() {
    let world = World::new("edited");
    let (out, changed) = (file(&world, "run.mcap"), file(&world, "changed.mcap"));
    let recorder = Recording::start(&world, &out, &["--once"]);
    drive(&swap(&world), Until::Arrived);
    assert_eq!(recorder.finish().0, 0);

    let mut done = None;
    edited(&out, &changed, |topic, data| {
        if topic != "/clearway/command" || done.is_some() {
            return;
        }
        let mut command = proto::Command::decode(data.as_slice()).unwrap();
        let tick = command.tick;
        let robot = &mut command.robots[5];
        if tick < 20 || robot.stop_reason != 0 {
            return;
        }
        let before = robot.omega_radps.unwrap().to_bits();
        robot.omega_radps = Some(f64::from_bits(before ^ 1));
        done = Some((tick, robot.id, before));
        *data = command.encode_to_vec();
    });
    let (tick, id, before) = done.unwrap();
    let (status, result) = replay(&world, &[&changed], &[]);
    assert_eq!(status, 1, "{result:#}");
    assert_eq!((&result["equal"], &result["different_commands"]), (&false.into(), &1.into()));
    let first = &result["first_difference"];
    assert_eq!((&first["tick"], &first["robot"]), (&tick.into(), &id.into()));
    assert_eq!(first["field"], "omega_radps");
    assert_eq!(first["recorded"]["bits"], format!("0x{:016x}", before ^ 1));
    assert_eq!(first["solved"]["bits"], format!("0x{before:016x}"));
    assert_eq!(first["solved"]["number"].as_f64().unwrap().to_bits(), before);
    let text = clearway(&world, &["replay", &changed.to_string_lossy()]).output().unwrap();
    let text = String::from_utf8(text.stdout).unwrap();
    assert!(text.contains(&format!("first: tick {tick}, robot {id}, field omega_radps")), "{text}");
    assert!(text.lines().all(|line| line.chars().count() <= 80), "{text}");

    // Changed bytes are not a difference but damage.
    let mut bytes = std::fs::read(&out).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 0x10;
    std::fs::write(&changed, bytes).unwrap();
    let output = clearway(&world, &["replay", &changed.to_string_lossy()]).output().unwrap();
    assert_eq!(output.status.code(), Some(2));
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(said.contains("damaged") && said.contains("changed.mcap"), "{said}");
}

#[test]
fn wrong_files_and_arguments_are_named() {
    let world = World::new("wrong");
    let (text, empty, other) =
        (file(&world, "text.mcap"), file(&world, "empty.mcap"), file(&world, "o.mcap"));
    std::fs::write(&text, "this is a text and no recording at all").unwrap();
    std::fs::write(&empty, "").unwrap();
    mcap::Writer::new(std::fs::File::create(&other).unwrap()).unwrap().finish().unwrap();
    let name = |path: &Path| path.to_string_lossy().into_owned();
    let cases: [(Vec<String>, i32, &str); 8] = [
        (vec!["replay".into(), name(&text)], 2, "is not an MCAP file"),
        (vec!["replay".into(), name(&empty)], 2, "is not an MCAP file"),
        (vec!["replay".into(), name(&other)], 2, "is an MCAP file without"),
        (vec!["replay".into(), name(&file(&world, "none.mcap"))], 2, "cannot be read"),
        (vec!["record".into(), name(&text)], 2, "exists"),
        (vec!["record".into(), "/no/such/place/x.mcap".into()], 2, "cannot be written"),
        (
            vec!["record".into(), name(&file(&world, "new.mcap")), "--wait".into(), "0s".into()],
            3,
            "no daemon",
        ),
        (
            vec!["record".into(), name(&text), "--overwrite".into(), "--wait".into(), "0s".into()],
            3,
            "no daemon",
        ),
    ];
    for (arguments, status, words) in cases {
        let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
        let output = clearway(&world, &arguments).output().unwrap();
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(status), "{arguments:?}: {said}");
        assert!(said.contains(words), "{arguments:?}: {said}");
        assert!(!said.contains("panicked"), "{said}");
    }
    assert_eq!(std::fs::read(&text).unwrap().len(), 38, "what was there is untouched");
    assert!(!file(&world, "text.mcap.part").exists());
    assert!(!file(&world, "new.mcap").exists(), "an empty recording would stand in the way of the next try");
}
