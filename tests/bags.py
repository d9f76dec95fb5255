"""Foreign recordings made here: ROS 2 bags, JSON messages, LeRobot data sets; their import by a mapping."""

import io
import json
import sqlite3

import numpy as np
import pyarrow as arrow
import pyarrow.parquet as parquet
import yaml
from mcap.writer import Writer
from mcap_ros2._dynamic import serialize_dynamic
from mcap_ros2.writer import Writer as RosWriter

from exodrake.data.import_log import import_recording, read_mapping

N = 40
TIME = 0.02 * np.arange(N)  # s
Q = np.column_stack([np.sin(3.0 * TIME), np.cos(2.0 * TIME)])  # angles of wrist and elbow [rad]
JOINT_STATE = """std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
WRENCH = """std_msgs/Header header
geometry_msgs/Wrench wrench
================================================================================
MSG: geometry_msgs/Wrench
geometry_msgs/Vector3 force
geometry_msgs/Vector3 torque
================================================================================
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
""" + JOINT_STATE[JOINT_STATE.index("=") :]
BAG_MAP = {
    "time": {"start": 0},
    "columns": {
        "/joint_states:position[MCP]": {"name": "angle_MCP", "unit": "rad"},
        "/joint_states:position[0]": {"name": "angle_PIP", "unit": "rad"},
        "/wrench:wrench.force.z": {"name": "force_z", "unit": "N"},
        "/command:data": {"name": "speed_cmd_AF", "unit": "mm/s"},
    },
}


def bag() -> bytes:
    """Joint states at 50 Hz, a wrench at 100 Hz that stops early, a command once in a while."""
    stream = io.BytesIO()
    writer = RosWriter(stream)
    joints = writer.register_msgdef("sensor_msgs/msg/JointState", JOINT_STATE)
    wrench = writer.register_msgdef("geometry_msgs/msg/WrenchStamped", WRENCH)
    number = writer.register_msgdef("std_msgs/msg/Float64", "float64 data\n")
    for n in range(200):
        stamp = 10_000_000 * n + 1_700_000_000_000_000_000
        header = {"stamp": {"sec": n // 100, "nanosec": n % 100 * 10_000_000}, "frame_id": ""}
        if n % 2 == 0:
            state = {"header": header, "name": ["PIP", "MCP"], "position": [n * 0.5, n * 1.0]}
            state |= {"velocity": [], "effort": []}
            writer.write_message("/joint_states", joints, state, log_time=stamp, publish_time=stamp)
        if n < 100:
            force = {"force": {"x": 0.0, "y": 0.0, "z": float(n)}, "torque": {"x": 0.0, "y": 0.0, "z": 0.0}}
            both = {"header": header, "wrench": force}
            writer.write_message("/wrench", wrench, both, log_time=stamp, publish_time=stamp)
        if n % 40 == 0:
            writer.write_message("/command", number, {"data": float(n)}, log_time=stamp, publish_time=stamp)
    writer.finish()
    return stream.getvalue()


BAG = bag()


def json_mcap(messages, encoding="json") -> bytes:
    """An MCAP file of messages (topic, time [s], content), as Foxglove's tools write it."""
    stream, channels = io.BytesIO(), {}
    writer = Writer(stream)
    writer.start(library="another program")
    for topic, time, content in messages:
        if topic not in channels:
            schema = writer.register_schema(name=topic[1:], encoding="jsonschema", data=b"{}")
            channels[topic] = writer.register_channel(topic=topic, message_encoding=encoding, schema_id=schema)
        stamp = round(1e9 * time)
        writer.add_message(channels[topic], log_time=stamp, publish_time=stamp, data=json.dumps(content).encode())
    writer.finish()
    return stream.getvalue()


def example_mcap(path, steps) -> None:
    """An episode as the logger of Google's Safari SDK writes it: a `tensorflow.Example` for each step and topic.

    Steps are (time [s], topic, features). The recorder's clock is that of the batch in which messages are written, the
    publisher's that of the step.
    """
    from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
    from mcap_protobuf.writer import Writer as ProtobufWriter

    file = descriptor_pb2.FileDescriptorProto(name="example.proto", package="tensorflow", syntax="proto3")
    for name, kind in (("BytesList", "BYTES"), ("FloatList", "FLOAT"), ("Int64List", "INT64")):
        own = file.message_type.add(name=name)
        own.field.add(
            name="value", number=1, label=3, type=getattr(descriptor_pb2.FieldDescriptorProto, f"TYPE_{kind}")
        )
    feature = file.message_type.add(name="Feature")
    feature.oneof_decl.add(name="kind")
    for number, name in enumerate(("bytes_list", "float_list", "int64_list"), 1):
        kind = name.title().replace("_", "")
        feature.field.add(name=name, number=number, label=1, type=11, type_name=f".tensorflow.{kind}", oneof_index=0)
    features = file.message_type.add(name="Features")
    entry = features.nested_type.add(name="FeatureEntry")
    entry.options.map_entry = True
    entry.field.add(name="key", number=1, label=1, type=9)
    entry.field.add(name="value", number=2, label=1, type=11, type_name=".tensorflow.Feature")
    features.field.add(name="feature", number=1, label=3, type=11, type_name=".tensorflow.Features.FeatureEntry")
    whole = file.message_type.add(name="Example")
    whole.field.add(name="features", number=1, label=1, type=11, type_name=".tensorflow.Features")
    pool = descriptor_pool.DescriptorPool()
    pool.Add(file)
    example = message_factory.GetMessageClass(pool.FindMessageTypeByName("tensorflow.Example"))
    with open(path, "wb") as stream, ProtobufWriter(stream) as writer:
        for time, topic, values in steps:
            message = example()
            for key, (kind, numbers) in values.items():
                getattr(message.features.feature[key], kind).value.extend(numbers)
            writer.write_message(
                topic, message, log_time=round(1e9 * (100.0 + time // 1.0)), publish_time=round(1e9 * time)
            )


def sqlite_bag(path, definitions: bool) -> None:
    """Joint states at 50 Hz and commands at 25 Hz as rosbag2 stores them, with or without message definitions."""
    kind = "sensor_msgs/msg/JointState"
    encode = serialize_dynamic(kind, JOINT_STATE)[kind]
    bag = sqlite3.connect(path)
    bag.execute("CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT)")
    bag.execute("CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)")
    own = "my_msgs/msg/State"
    if definitions:
        bag.execute("CREATE TABLE message_definitions(topic_type TEXT, encoding TEXT, encoded_message_definition TEXT)")
        bag.execute("INSERT INTO message_definitions VALUES(?, 'ros2msg', ?)", (own, JOINT_STATE))
    for number, topic in enumerate(("/joint_states", "/joint_command")):
        bag.execute("INSERT INTO topics VALUES(?, ?, ?, 'cdr')", (number, topic, own if definitions else kind))
        for n in range(0, N, 1 + number):
            stamp = 1_700_000_000_000_000_000 + 20_000_000 * n
            header = {"stamp": {"sec": stamp // 10**9, "nanosec": stamp % 10**9}, "frame_id": ""}
            state = {"header": header, "name": ["wrist", "elbow"], "position": Q[n].tolist()}
            state |= {"velocity": [], "effort": []}
            bag.execute("INSERT INTO messages VALUES(NULL, ?, ?, ?)", (number, stamp + 3_000_000, encode(state)))
    bag.commit()
    bag.close()


def imported(folder, content, mapping, name="drive.csv"):
    """The log of a recording by a mapping, both as files, as the command does."""
    (folder / "map.yaml").write_text(mapping if isinstance(mapping, str) else yaml.safe_dump(mapping))
    (folder / name).write_bytes(content.encode() if isinstance(content, str) else content)
    return import_recording(folder / name, read_mapping(folder / "map.yaml")).log


def lerobot(folder, episodes, names=("wrist_flex.pos", "elbow_flex.pos"), grouped=False):
    """A LeRobot data set of file -> numbers of episodes, whose states are 10 Q and the number, their actions 10 Q."""
    (folder / "meta").mkdir(parents=True)
    feature = {"dtype": "float32", "shape": [2], "names": {"motors": list(names)} if grouped else list(names)}
    info = {"fps": 50, "features": {"action": feature, "observation.state": feature}}
    (folder / "meta" / "info.json").write_text(json.dumps(info))
    for file, numbers in episodes.items():
        path = folder / "data" / file
        path.parent.mkdir(parents=True, exist_ok=True)
        tables = [
            arrow.table({
                "action": (10.0 * Q).tolist(), "observation.state": (10.0 * Q + number).tolist(),
                "timestamp": TIME.tolist(), "episode_index": [number] * N,
            })
            for number in numbers
        ]  # fmt: skip
        parquet.write_table(arrow.concat_tables(tables), path)
    return folder
