"""Topics that commands come on: in either type, polled once per period, each with who sent it.

Commands take effect once per period of control, so they are taken in at its beginning. An executor would
not say who sent one, and would hold on to a subscription whose type is to change.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

from trundle.apps.ros2 import messages
from trundle.apps.ros2.endpoints import chosen_type
from trundle.apps.ros2.installation import message_type
from trundle.apps.ros2.lease import Source
from trundle.geometry import Twist2D

__all__ = ["Command", "CommandTopics"]

STAMPED, PLAIN = TWISTS = ("geometry_msgs/msg/TwistStamped", "geometry_msgs/msg/Twist")


class Command(NamedTuple):
    """What came.

    Attributes:
        twist: As it is.
        source: Who sent it.
        stamp_ns: When, by the sender's clock; None where the type does not say.
    """

    twist: Twist2D
    source: Source
    stamp_ns: int | None


class CommandTopics:
    """The subscriptions for commands.

    Args:
        node: rclpy's; its executor must leave `subscriptions` alone.
        topics: The highest priority first.

    Attributes:
        subscriptions: Those that this object polls.
    """

    def __init__(self, node: Any, topics: Sequence[str]) -> None:
        self._node = node
        self._names = [node.resolve_topic_name(topic) for topic in topics]
        self._kinds = dict.fromkeys(self._names, STAMPED)
        self._by_topic: dict[str, Any] = {}
        self._anonymous = False
        for topic in self._names:
            self._subscribe(topic)

    @property
    def subscriptions(self) -> list[Any]:
        """What no executor may take from."""
        return list(self._by_topic.values())

    @property
    def names(self) -> list[str]:
        """The topics' full names."""
        return list(self._names)

    def take(self) -> Iterator[Command]:
        """Every command that has come since, the highest priority first."""
        for priority, topic in enumerate(self._names):
            subscription = self._by_topic.get(topic)
            if subscription is None:
                continue
            while (taken := subscription.handle.take_message(subscription.msg_type, False)) is not None:
                message, info = taken
                sender = info.get("publisher_gid") if isinstance(info, dict) else None
                self._anonymous = not sender
                source = Source(topic, sender["data"].hex() if sender else "", priority)
                if self._kinds[topic] == PLAIN:
                    yield Command(messages.read_twist(message), source, None)
                else:
                    stamp = messages.read_stamp(message.header.stamp)
                    yield Command(messages.read_twist(message.twist), source, stamp)

    def follow(self) -> None:
        """Take the type that is published: DDS knows one per topic and program."""
        for topic, kind in self._kinds.items():
            publishers = self._node.get_publishers_info_by_topic(topic)
            wanted = chosen_type(kind, TWISTS, [one.topic_type for one in publishers])
            if wanted != kind:
                self._kinds[topic] = wanted
                self._node.destroy_subscription(self._by_topic.pop(topic))
            if topic not in self._by_topic:
                with contextlib.suppress(RuntimeError):  # the old type is not quite gone: try again
                    self._subscribe(topic)

    def sender(self, source: Source) -> str:
        """The name of the node that sent a command, where the middleware tells; else the topic."""
        for one in self._node.get_publishers_info_by_topic(source.topic):
            if bytes(one.endpoint_gid).hex() == source.publisher:
                return f"{one.node_namespace.rstrip('/')}/{one.node_name} on {source.topic}"
        return source.topic

    def crowded(self) -> list[str]:
        """Sentences on topics where several controllers publish and nobody says who sent what."""
        if not self._anonymous:
            return []
        counts = {topic: self._node.count_publishers(topic) for topic in self._names}
        return [
            f"{topic} has {count} publishers, and this ROS does not say who sent what: "
            "give each controller a topic of its own in cmd_vel_topics"
            for topic, count in counts.items()
            if count > 1
        ]

    def _subscribe(self, topic: str) -> None:
        from rclpy.event_handler import SubscriptionEventCallbacks
        from rclpy.qos_overriding_options import QoSOverridingOptions

        kind = message_type("geometry_msgs.msg", self._kinds[topic].rpartition("/")[2])
        self._by_topic[topic] = self._node.create_subscription(
            kind,
            topic,
            _unused,
            10,
            event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
            qos_overriding_options=QoSOverridingOptions.with_default_policies(),
        )


def _unused(_message: Any) -> None:
    """No executor calls this."""
