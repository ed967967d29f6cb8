"""PointCloud2 as bytes: the same as rclpy writes."""

import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import PointCloud2

from msg_tools import topics
from msg_tools.cloud_tables import cloud_to_table, quick_cloud, table_to_cloud
from msg_tools.node import MountNode
from msg_tools.quick_clouds import CloudWriter

NS = 10**18 + 7


@pytest.mark.parametrize('frame', ['', 'a', 'ab', 'abc', 'mount_enu', 'möunt'])
@pytest.mark.parametrize('drawn', [True, False])
def test_tables_are_written_as_by_rclpy(frame, drawn):
    rng, writer = np.random.default_rng(1), CloudWriter()
    for rows in (1, 1, 3, 0, 40):
        for names in (['time'], ['time', 'az', 'a name of ten'], ['e', 'ab', 'abc', 'abcd']):
            table = {name: rng.normal(size=rows) for name in names}
            points = rng.normal(size=(3, rows)) if drawn else None
            data = writer.write(quick_cloud(table, NS, points, frame))
            theirs = table_to_cloud(table, NS, points, frame)
            assert deserialize_message(data, PointCloud2) == theirs
            expected = serialize_message(theirs)
            # rclpy leaves gaps as they were
            assert all(a == b or a == 0 for a, b in zip(data, expected))
            assert len(data) <= len(expected)
            back = cloud_to_table(deserialize_message(data, PointCloud2))
            assert list(back) == names
            assert all(np.array_equal(back[name], table[name]) for name in names)


def test_a_node_publishes_both_kinds(graph):
    class Teller(MountNode):
        def __init__(self, **kwargs):
            super().__init__('teller', **kwargs)
            self.pub = self.publisher(topics.OBSERVATION)

    node, got = graph.add(Teller), graph.listen(topics.OBSERVATION)
    graph.connect()
    table = {'time': [1.0], 'az': [np.pi]}
    node.pub.publish(table_to_cloud(table, NS))
    node.pub.publish(quick_cloud(table, NS))
    graph.wait_for(lambda: len(got) == 2, 'both')
    assert got[0] == got[1]
