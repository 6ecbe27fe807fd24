import sys

import pytest
from pydrake.common.value import AbstractValue
from pydrake.systems.framework import LeafSystem

from arm_drake.controllers.topics import add_events, new_messages
from arm_drake.messages import Float64MultiArray, TopicRejected
from arm_drake.messages.base import NUM_KEPT

A, B, C = (Float64MultiArray([value]) for value in (1.0, 2.0, 3.0))


class Reader(LeafSystem):
    """Has a topic."""

    def __init__(self) -> None:
        super().__init__()
        self.topic = self.DeclareAbstractInputPort("topic", AbstractValue.Make(()))


@pytest.mark.parametrize(
    ("seen", "available", "new"),
    [
        ((), None, ()),
        ((), A, (A,)),
        ((A,), A, ()),
        ((A,), (A,), ()),
        ((A,), B, (B,)),
        ((A,), (A, B), (B,)),
        ((), (A, B), (A, B)),
        ((A, B), (A, B), ()),
        ((A, B), (C, B), (C,)),
        ((A,), (), ()),
    ],
)
def test_other_objects_than_at_the_last_tick_are_new(seen, available, new) -> None:
    system = Reader()
    context = system.CreateDefaultContext()
    if available is not None:
        system.topic.FixValue(context, available)

    found, now_seen = new_messages(system.topic, context, Float64MultiArray, seen)

    assert found == new
    assert set(new) <= set(now_seen)
    again = new_messages(system.topic, context, Float64MultiArray, now_seen)
    assert again[0] == ()
    assert again[1] is now_seen


def test_a_message_that_was_away_is_new_again() -> None:
    system = Reader()
    context = system.CreateDefaultContext()
    seen = (A,)

    for available, new in ((A, ()), ((), ()), (A, (A,))):
        system.topic.FixValue(context, available)
        found, seen = new_messages(system.topic, context, Float64MultiArray, seen)
        assert found == new


def test_many_messages_after_as_many_are_found_in_one_pass() -> None:
    system, num_messages = Reader(), 300
    context = system.CreateDefaultContext()
    seen, news = (
        tuple(Float64MultiArray([1.0]) for _ in range(num_messages)) for _ in range(2)
    )
    system.topic.FixValue(context, seen[-1:] + news)
    events: list[str] = []

    sys.setprofile(lambda frame, event, argument: events.append(event))
    try:
        found, _ = new_messages(system.topic, context, Float64MultiArray, seen)
    finally:
        sys.setprofile(None)

    assert len(found) == num_messages
    assert all(one is other for one, other in zip(found, news, strict=True))
    # To compare each with each would take 90,000.
    assert len(events) < 10 * num_messages


def test_events_are_numbered_and_the_latest_are_kept() -> None:
    last = NUM_KEPT + 5
    news = [TopicRejected(A, str(number)) for number in range(last + 1)]

    events = add_events(add_events((), news[:1]), news[1:])

    assert [number for number, _ in events] == list(range(6, last + 1))
    assert events[-1] == (last, news[-1])
    assert add_events(events, ()) is events
