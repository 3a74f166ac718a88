"""Reads a recording with the independent `mcap` package and tells what is in it, as JSON.

recording.py FILE [--cut-off]: with the second, a missing end is no error.
"""

import json
import struct
import sys

from mcap.exceptions import McapError
from mcap.reader import NonSeekingReader, make_reader
from mcap_protobuf.decoder import DecoderFactory as Protobuf
from mcap_ros2.decoder import DecoderFactory as Ros2


def bits(x):
    return struct.unpack("<Q", struct.pack("<d", x))[0]


def main():
    path, cut_off = sys.argv[1], "--cut-off" in sys.argv
    out = {"ticks": {}, "schemas": {}, "commands": {}, "metadata": [], "attachments": [], "times": []}
    with open(path, "rb") as file:
        factories = [Protobuf(), Ros2()]
        if cut_off:
            reader = NonSeekingReader(file, decoder_factories=factories, validate_crcs=True)
            messages = reader.iter_decoded_messages(log_time_order=False)
        else:
            reader = make_reader(file, decoder_factories=factories, validate_crcs=True)
            summary = reader.get_summary()
            out["statistics"] = summary.statistics.message_count
            out["chunks"] = summary.statistics.chunk_count
            out["metadata"] = [dict(m.metadata, name=m.name) for m in reader.iter_metadata()]
            out["attachments"] = [a.name for a in reader.iter_attachments()]
            messages = reader.iter_decoded_messages()
        messages = iter(messages)
        while True:
            try:
                schema, channel, message, decoded = next(messages)
            except StopIteration:
                break
            except (McapError, EOFError, struct.error) as error:
                if not cut_off:
                    raise
                out["ended_with"] = type(error).__name__
                break
            topic = channel.topic
            out["schemas"][topic] = [schema.name, schema.encoding, channel.message_encoding]
            out["times"] = [min(out["times"][:1] + [message.log_time]), max(out["times"][1:] + [message.log_time])]
            if topic.startswith("/clearway/") and topic != "/clearway/recorder":
                out["ticks"].setdefault(topic, []).append(decoded.tick)
            if topic == "/clearway/command":
                robots = [[r.id, r.stop_reason, bits(r.v_mps), bits(r.omega_radps)] for r in decoded.robots]
                out["commands"][decoded.tick] = robots
            if topic == "/fleet/poses":
                out["poses"] = [[p.position.x, p.position.y] for p in decoded.poses]
            if topic == "/fleet/scene":
                out.setdefault("entities", []).append([entity.id for entity in decoded.entities])
            if topic.endswith("/twist"):
                twist = [decoded.twist.linear.x, decoded.twist.angular.z]
                out.setdefault("twists", {})[topic] = [decoded.header.frame_id, *twist]
            if topic.endswith("/pose"):
                at = decoded.pose.position
                out.setdefault("robot_poses", {})[topic] = [decoded.header.frame_id, at.x, at.y]
    print(json.dumps(out))


main()
