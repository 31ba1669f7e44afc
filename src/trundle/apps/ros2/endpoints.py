"""Who publishes and subscribes what, and why two of them do not hear each other (FAULTS.md R1).

DDS says nothing to people where types or qualities of service do not match: messages just do not come.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

__all__ = ["Endpoint", "QoS", "chosen_type", "mismatch", "mismatches"]


class QoS(NamedTuple):
    """What matters of a quality of service.

    Attributes:
        reliable: Lost messages are sent again; otherwise best effort.
        transient_local: Who comes late gets what was sent before; otherwise volatile.
        deadline: Longest time between messages [s].
        manual_liveliness: The program itself says that it lives.
        lease: How long it lives without saying so [s].
    """

    reliable: bool = True
    transient_local: bool = False
    deadline: float = math.inf
    manual_liveliness: bool = False
    lease: float = math.inf

    def __str__(self) -> str:
        words = [
            "reliable" if self.reliable else "best_effort",
            "transient_local" if self.transient_local else "volatile",
        ]
        if self.deadline < math.inf:
            words.append(f"deadline {self.deadline:g} s")
        if self.manual_liveliness:
            words.append("manual liveliness")
        if self.lease < math.inf:
            words.append(f"liveliness lease {self.lease:g} s")
        return ", ".join(words)


class Endpoint(NamedTuple):
    """A publisher or a subscription.

    Attributes:
        node: Full name of its node.
        topic: Full name.
        type: Of its messages.
        publishes: Or subscribes.
        qos: Offered by a publisher, requested by a subscription.
    """

    node: str
    topic: str
    type: str
    publishes: bool
    qos: QoS = QoS()


def mismatch(publisher: Endpoint, subscription: Endpoint) -> str:
    """What keeps a subscription from hearing a publisher of its topic; "" if nothing does.

    Source:
        OMG DDS 1.4, table 2.2.3: offered must be at least requested.
    """
    if publisher.type != subscription.type:
        return "type"
    offered, wanted = publisher.qos, subscription.qos
    worse = {
        "reliability": wanted.reliable and not offered.reliable,
        "durability": wanted.transient_local and not offered.transient_local,
        "deadline": offered.deadline > wanted.deadline,
        "liveliness": wanted.manual_liveliness and not offered.manual_liveliness,
        "liveliness lease": offered.lease > wanted.lease,
    }
    return ", ".join(name for name, is_worse in worse.items() if is_worse)


def mismatches(mine: Iterable[Endpoint], others: Sequence[Endpoint]) -> list[str]:
    """One sentence for every pair of endpoints that share a topic and do not hear each other.

    Args:
        mine: This node's own.
        others: Of everybody else on these topics.
    """
    sentences = []
    for own in mine:
        for other in others:
            if other.topic != own.topic or other.publishes is own.publishes:
                continue
            publisher, subscription = (own, other) if own.publishes else (other, own)
            if why := mismatch(publisher, subscription):
                sentences.append(_sentence(publisher, subscription, why))
    return sentences


def _sentence(publisher: Endpoint, subscription: Endpoint, why: str) -> str:
    if why == "type":
        offered, wanted = publisher.type, subscription.type
    else:
        offered, wanted = str(publisher.qos), str(subscription.qos)
    return (
        f"{publisher.topic}: {why} does not match: {publisher.node} publishes ({offered}), "
        f"{subscription.node} subscribes ({wanted}): nothing arrives"
    )


def chosen_type(current: str, known: Sequence[str], offered: Iterable[str]) -> str:
    """The type to subscribe: DDS allows one per topic and program, and publishers choose.

    Args:
        current: That is subscribed now; it stays as long as anybody publishes it, or nobody another.
        known: Those that can be subscribed, the preferred first.
        offered: Those that are published.
    """
    offered = set(offered)
    if current in offered:
        return current
    return next((name for name in known if name in offered), current)
