"""The messages of a ROS 1 bag as ROS itself reads or writes them (Debian: python3-rosbag).

    rosbag_messages.py read BAG LIST
    rosbag_messages.py write LIST BAG none|bz2|lz4

LIST holds the messages one after the other, each as time in ns (uint64), and topic, type and bytes,
each with its length before it (uint32); all little-endian.
"""
import struct
import sys

import genpy
import rosbag

_DEFINITION = "float32 x\n"
_DEFINITION_MD5 = "abd5d1e9c3ac157a0df3ba27b65d3384"


def read_list(path):
    with open(path, "rb") as file:
        data = file.read()
    at = 0

    def text():
        nonlocal at
        (size,) = struct.unpack_from("<I", data, at)
        at += 4 + size
        return data[at - size:at]

    while at < len(data):
        (stamp_ns,) = struct.unpack_from("<Q", data, at)
        at += 8
        yield stamp_ns, text().decode(), text().decode(), text()


def write_list(path, messages):
    with open(path, "wb") as file:
        for stamp_ns, topic, kind, content in messages:
            file.write(struct.pack("<Q", stamp_ns))
            for part in (topic.encode(), kind.encode(), content):
                file.write(struct.pack("<I", len(part)) + part)


def read_bag(path):
    with rosbag.Bag(path) as bag:
        for topic, message, stamp in bag.read_messages(raw=True):
            yield stamp.to_nsec(), topic, message[0], message[1]


def write_bag(path, messages, compression):
    class Any:
        _md5sum = _DEFINITION_MD5
        _full_text = _DEFINITION

    with rosbag.Bag(path, "w", compression=compression, chunk_threshold=10_000) as bag:
        for stamp_ns, topic, kind, content in messages:
            stamp = genpy.Time(stamp_ns // 10**9, stamp_ns % 10**9)
            bag.write(topic, (kind, content, Any._md5sum, Any), stamp, raw=True)


if sys.argv[1] == "read":
    write_list(sys.argv[3], read_bag(sys.argv[2]))
else:
    write_bag(sys.argv[3], read_list(sys.argv[2]), sys.argv[4])
