"""`/tf`: where each part is in ground's frame. Needs tf2_msgs, which a full ROS 2 installation has."""

from __future__ import annotations

import importlib

from geometry_msgs.msg import Transform, TransformStamped, Vector3
from rclpy.node import Node
from std_msgs.msg import Header

from mbd_sim.mechanism.records import GROUND
from mbd_sim.ros import qos
from mbd_sim.ros.message_template import STAMP, Template, slot
from mbd_sim.ros.publisher import Output
from mbd_sim.ros.snapshots import Snapshot
from mbd_sim.ros.state_messages import Telling, placed
from mbd_sim.simulation.compiled_model import Model


def transforms(node: Node, model: Model, prefix: str) -> Telling:
    """A transform from ground to each part.

    :raises ImportError: tf2_msgs is not installed.
    """
    try:
        message_type = importlib.import_module("tf2_msgs.msg").TFMessage
    except ImportError as error:
        raise ImportError("parameter 'tf': tf2_msgs is not installed. Leave it out, or install that.") from error
    header = Header(stamp=STAMP, frame_id=prefix + GROUND)
    found = [
        TransformStamped(
            header=header, child_frame_id=prefix + name, transform=Transform(translation=Vector3(x=slot(index)))
        )
        for index, name in enumerate(model.part_names)
    ]
    template = Template(message_type(transforms=found))
    rows = [template.doubles(index, 7) for index in range(len(found))]

    def write(snapshot: Snapshot) -> None:
        for row, values in zip(rows, placed(model.pose_array(snapshot.time, snapshot.y, snapshot.inputs)), strict=True):
            row[:] = values

    return Telling(Output(node, message_type, "/tf", qos.STATE), template, write)
