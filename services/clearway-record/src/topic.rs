//! The topics of a recording: names, schemas, encodings.

use crate::schema::descriptor;

/// The fleet's states, every one: `clearway.v1.State`.
pub const STATE: &str = "/clearway/state";
/// The commands, every one: `clearway.v1.Command`.
pub const COMMAND: &str = "/clearway/command";
/// How each period went: `clearway.v1.Telemetry`.
pub const TELEMETRY: &str = "/clearway/telemetry";
/// What a replay starts from: `clearway.v1.Checkpoint`.
pub const CHECKPOINT: &str = "/clearway/checkpoint";
/// How the recording goes: `clearway.v1.Recorder`.
pub const RECORDER: &str = "/clearway/recorder";
/// All poses: `foxglove.PosesInFrame`.
pub const POSES: &str = "/fleet/poses";
/// Bodies, goals and obstacles to look at: `foxglove.SceneUpdate`.
pub const SCENE: &str = "/fleet/scene";

/// The pose of one robot: `geometry_msgs/msg/PoseStamped`.
pub fn pose_of(id: u32) -> String {
    format!("/robot/{id}/pose")
}

/// The command in force of one robot: `geometry_msgs/msg/TwistStamped`.
pub fn twist_of(id: u32) -> String {
    format!("/robot/{id}/twist")
}

/// How the messages of a topic are declared.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Declaration {
    /// Name of the schema.
    pub schema: &'static str,
    /// Encoding of the schema.
    pub schema_encoding: &'static str,
    /// The schema itself.
    pub data: Vec<u8>,
    /// Encoding of the messages.
    pub encoding: &'static str,
}

/// The declaration of `topic`.
pub fn declaration(topic: &str) -> Declaration {
    match topic {
        STATE => protobuf("clearway.v1.State"),
        COMMAND => protobuf("clearway.v1.Command"),
        TELEMETRY => protobuf("clearway.v1.Telemetry"),
        CHECKPOINT => protobuf("clearway.v1.Checkpoint"),
        RECORDER => protobuf("clearway.v1.Recorder"),
        POSES => protobuf("foxglove.PosesInFrame"),
        SCENE => protobuf("foxglove.SceneUpdate"),
        robot if robot.ends_with("/twist") => ros2("geometry_msgs/msg/TwistStamped", TWIST_STAMPED),
        _ => ros2("geometry_msgs/msg/PoseStamped", POSE_STAMPED),
    }
}

fn protobuf(schema: &'static str) -> Declaration {
    Declaration { schema, schema_encoding: "protobuf", data: descriptor(schema), encoding: "protobuf" }
}

fn ros2(schema: &'static str, text: &str) -> Declaration {
    Declaration { schema, schema_encoding: "ros2msg", data: text.as_bytes().to_vec(), encoding: "cdr" }
}

const POSE_STAMPED: &str = "\
std_msgs/Header header
geometry_msgs/Pose pose
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
================================================================================
MSG: geometry_msgs/Pose
geometry_msgs/Point position
geometry_msgs/Quaternion orientation
================================================================================
MSG: geometry_msgs/Point
float64 x
float64 y
float64 z
================================================================================
MSG: geometry_msgs/Quaternion
float64 x
float64 y
float64 z
float64 w
";

const TWIST_STAMPED: &str = "\
std_msgs/Header header
geometry_msgs/Twist twist
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
================================================================================
MSG: geometry_msgs/Twist
geometry_msgs/Vector3 linear
geometry_msgs/Vector3 angular
================================================================================
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
";
