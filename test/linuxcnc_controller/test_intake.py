"""What comes is followed or held, and why and since when is said at once."""

import pytest
from faults.documenting import Row, shows

from rotary_error_monitor.linuxcnc_controller.gate import CorrectionMessage, GateLimits, RefusalError, RefusalReason
from rotary_error_monitor.linuxcnc_controller.intake import NOTHING_COMES, NOTHING_YET, PRESENT, CorrectionIntake

MS = 10**6
NOW = 1_800_000_000_000_000_000
LIMITS = GateLimits(("X", "A"), (5e-4, 5e-3), ("X", "A"))


class Desk:
    """An intake and its time; each message comes 10 ms after the one before and is 20 ms old."""

    def __init__(self, *listed):
        self.intake = CorrectionIntake(LIMITS)
        self.time_ns, self.number = 0, 100
        self.intake.sources.enlist(listed or ("/compensation",), 0)

    def wait(self, milliseconds):
        self.time_ns += milliseconds * MS
        return self.hold

    def send(self, names="XA", number=None, age_ms=20):
        self.wait(10)
        self.number += 1
        message = CorrectionMessage(NOW + self.time_ns - age_ms * MS, names, (1e-6,) * len(names))
        number = self.number if number is None else number
        try:
            self.intake.take(message, number, NOW + self.time_ns, self.time_ns)
        except RefusalError as error:
            return error.doubt
        return None

    @property
    def hold(self):
        return self.intake.hold(self.time_ns)


def test_before_the_first_correction_it_waits():
    desk = Desk()
    assert str(desk.wait(5000)) == f"held: {NOTHING_YET}"
    assert desk.hold.doubt is None


def test_while_corrections_come_nothing_is_held():
    desk = Desk()
    for _ in range(100):
        assert desk.send() is None
        assert desk.hold is None
    assert desk.wait(100) is None


@shows(
    Row(
        "corrections",
        "A second publisher of corrections that speaks seldom, once a second or less",
        "`corrections` of the controller's node: two publishers, for half a second after each of its messages",
        "none of its messages is followed; one that was heard and is silent for half a second does not count",
        "the axes rest for half a second after each of its messages, and follow the other one between them",
        "half a second after its last message",
    )
)
@pytest.mark.parametrize("pause_ms", [1000, 2000, 5000])
def test_of_a_second_publisher_that_speaks_seldom_nothing_is_followed(pause_ms):
    desk = Desk("/compensation", "/rogue")
    sent, followed = {7: [], 100: []}, {7: 0, 100: 0}
    numbers = dict.fromkeys(sent, 0)
    for step in range(10 * pause_ms // 10):
        who = 7 if step % (pause_ms // 10) == 50 else 100
        numbers[who] += 1
        refused = desk.send(number=10_000 * who + numbers[who])
        followed[who] += refused is None
        sent[who].append(refused)
    assert followed[7] == 0 and set(sent[7]) == {RefusalReason.PUBLISHERS}
    assert followed[100] / len(sent[100]) == pytest.approx(1.0 - 500 / pause_ms, abs=0.06)


def test_without_corrections_the_last_one_is_held_after_their_largest_age():
    desk = Desk()
    desk.send()
    assert str(desk.wait(101)) == f"held for 0.1 s: {NOTHING_COMES}"
    assert str(desk.wait(1100)) == f"held for 1.2 s: {NOTHING_COMES}"
    assert desk.send() is None
    assert desk.hold is None


def test_a_refused_message_among_good_ones_holds_nothing_and_is_said_for_a_while():
    desk = Desk()
    desk.send()
    assert desk.send("X") is RefusalReason.AXES
    assert desk.send() is None
    assert desk.hold is None
    assert desk.intake.refused == {RefusalReason.AXES: 1}
    remark = desk.intake.remark(desk.time_ns)
    assert remark.startswith("1 refused so far, the last one: corrections of the axes X;")
    for _ in range(round(PRESENT * 100)):
        desk.send()
    assert desk.intake.remark(desk.time_ns) == ""


def test_refused_messages_hold_with_their_reason_until_a_good_one_comes():
    desk = Desk()
    assert desk.intake.remark(0) == ""
    desk.send()
    for _ in range(20):
        assert desk.send("XX") is RefusalReason.AXES
    assert desk.hold.doubt is RefusalReason.AXES
    assert str(desk.hold).startswith("held for 0.2 s: corrections of the axes X X")
    assert desk.intake.refused[RefusalReason.AXES] == 20
    assert desk.send() is None
    assert desk.hold is None


def test_a_refusal_of_long_ago_is_no_reason():
    desk = Desk()
    desk.send("")
    assert desk.hold.doubt is RefusalReason.AXES
    assert str(desk.wait(2000)) == f"held: {NOTHING_YET}"


@pytest.mark.parametrize("second", [5, 10_000])
def test_a_second_publisher_holds_at_its_first_word_and_is_said_by_name(second):
    desk = Desk()
    for _ in range(10):
        desk.send()
    desk.intake.sources.enlist(("/compensation", "/double"), desk.time_ns)
    assert desk.hold.doubt is RefusalReason.PUBLISHERS
    assert str(desk.hold) == "held for 0.0 s: 2 publishers of corrections are there: /compensation, /double"
    for index in range(100):
        assert desk.send() is RefusalReason.PUBLISHERS
        assert desk.send(number=second + index) is RefusalReason.PUBLISHERS
    assert str(desk.hold) == "held for 2.0 s: 2 publishers send corrections at once: /compensation, /double"
    desk.intake.sources.enlist(("/compensation",), desk.time_ns)
    refused = 0
    while desk.send() is not None:
        refused += 1
    assert refused <= 50
    assert desk.hold is None


def test_messages_without_numbers_are_judged_by_the_list():
    desk = Desk("/a")
    message = CorrectionMessage(NOW - MS, "XA", (0.0, 0.0))
    assert desk.intake.take(message, None, NOW, 0).positions == (0.0, 0.0)
    desk.intake.sources.enlist(("/a", "/b"), 0)
    with pytest.raises(RefusalError, match="2 publishers of corrections are there: /a, /b"):
        desk.intake.take(message, None, NOW, 0)
