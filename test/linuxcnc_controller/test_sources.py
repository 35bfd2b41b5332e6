"""One publisher is told from several by the numbers of its messages, through losses, ends and new beginnings."""

from hypothesis import assume, given
from hypothesis import strategies as st

from rotary_error_monitor.linuxcnc_controller.sources import SILENCE, Sources

PERIOD = 10_000_000
SILENCE_NS = round(SILENCE * 1e9)
counts = st.integers(0, 2**40)


class Ear:
    """Hears messages and asks for the list as a node does: now and then, and whenever a message does not continue."""

    def __init__(self, *listed):
        self.sources, self.listed, self.now_ns = Sources(), listed, 10**12

    def hear(self, number, after_ns=PERIOD):
        """Whether the message comes from the only publisher, as far as is known."""
        self.now_ns += after_ns
        if not self.sources.continues(number):
            self.enlist(*self.listed)
        self.sources.hear(number, self.now_ns)
        return not self.trouble

    def enlist(self, *listed):
        self.listed = listed
        self.sources.enlist(listed, self.now_ns)

    @property
    def trouble(self):
        return self.sources.trouble(self.now_ns)


@given(counts, st.lists(st.tuples(st.integers(1, 900), st.integers(0, 10**9)), max_size=50))
def test_one_publisher_is_heard_whatever_is_lost(start, losses):
    ear, number = Ear("/compensation"), start
    for lost, after_ns in losses:
        number += lost
        assert ear.hear(number, after_ns)


@given(counts, counts)
def test_two_that_send_by_turns_are_noticed_even_where_only_one_is_listed(first, second):
    """Whatever their numbers: where one falls back, and at the latest when the other goes on."""
    ear = Ear("/compensation")
    for index in range(100):
        assert ear.hear(first + index)
    believed = []
    for index in range(60):
        believed += [ear.hear(second + index), ear.hear(first + 100 + index)]
    assert sum(believed) <= 3
    assert not any(believed[4:])
    assert ear.trouble.startswith("2 publishers send corrections at once")


@given(counts, counts, st.integers(1, 20))
def test_a_slow_one_beside_a_fast_one_is_not_heard(first, second, seconds):
    """Both are listed and both were heard. Once at most, where the fast one's numbers pass its own, it is mistaken."""
    assume(first != second + 1)
    ear = Ear("/fast", "/slow")
    ear.hear(second)
    ear.hear(first)
    slow = []
    for each in range(seconds):
        heard = [ear.hear(first + 1 + each * 100 + index) for index in range(100)]
        assert heard == [False] * heard.count(False) + [True] * heard.count(True)
        assert heard.count(False) * PERIOD <= SILENCE_NS
        slow.append(ear.hear(second + 1 + each))
    assert sum(slow) <= 1


@given(counts, counts)
def test_a_second_one_is_noticed_when_it_is_listed_before_it_says_a_word(first, second):
    ear = Ear("/compensation")
    assert ear.hear(first)
    ear.enlist("/compensation", "/double")
    assert ear.trouble == "2 publishers of corrections are there: /compensation, /double"
    assert not ear.hear(first + 1)
    assert not ear.hear(second)
    ear.enlist("/compensation")
    assert ear.hear(first + 2, SILENCE_NS + 1)


@given(counts, counts, st.integers(0, 10**10))
def test_an_orderly_restart_goes_on_at_once(first, second, pause_ns):
    ear = Ear("/compensation")
    for index in range(10):
        assert ear.hear(first + index)
    ear.enlist()
    ear.listed = ("/compensation",)
    assert ear.hear(second, pause_ns + PERIOD)
    assert all(ear.hear(second + index) for index in range(1, 100))


@given(counts, counts, st.integers(0, 100))
def test_a_third_one_does_not_pass_for_the_one_that_has_just_gone(first, second, words):
    assume(second != first + 10)
    ear = Ear("/compensation")
    for index in range(10):
        assert ear.hear(first + index)
    for index in range(words + 1):
        assert ear.hear(second + index)
    ear.enlist("/compensation", "/third")
    assert ear.trouble == "2 publishers of corrections are there: /compensation, /third"


@given(counts, counts, st.integers(0, 10**10), st.integers(1, 5))
def test_after_one_was_killed_its_successor_goes_on_within_a_second_though_it_is_still_listed(
    first, second, pause_ns, times
):
    """The list keeps the dead for up to 20 s; if a number goes on by chance, it is waited for."""
    assume(second != first + 10)
    ear = Ear("/compensation")
    for index in range(10):
        assert ear.hear(first + index)
    for restart in range(times):
        number = second + 10_000 * restart
        ear.listed = (*ear.listed, "/compensation")
        ear.hear(number, pause_ns + PERIOD)
        for index in range(1, 100):
            alone = ear.hear(number + index)
            assert alone or index * PERIOD <= SILENCE_NS
    ear.enlist("/compensation")
    assert ear.hear(number + 100)


def test_a_listed_one_that_was_heard_and_wakes_up_is_noticed_at_its_first_word():
    ear = Ear("/a", "/b")
    for index in range(100):
        ear.hear(index)
        if index < 10:
            ear.hear(7000 + index)
    assert not ear.trouble
    assert not ear.hear(7010)
    assert ear.trouble == "2 publishers send corrections at once: /a, /b"


def test_without_numbers_the_list_alone_decides():
    ear = Ear()
    assert not ear.trouble
    ear.enlist("/a")
    assert not ear.trouble
    ear.enlist("/a", "/b")
    assert ear.trouble == "2 publishers of corrections are there: /a, /b"


def test_several_that_nobody_lists_are_told_apart_too():
    ear = Ear()
    assert ear.hear(10)
    assert not ear.hear(5)
    assert ear.trouble == "2 publishers send corrections at once: unknown"


def test_a_crowd_is_named_in_short():
    ear = Ear()
    ear.enlist(*(f"/{index}" for index in range(1000)))
    assert ear.trouble == "1000 publishers of corrections are there: /0, /1, /2, /3 and 996 more"


@given(st.lists(counts, min_size=50, max_size=50, unique=True))
def test_numbers_without_rhyme_are_many_publishers_and_forgotten(numbers):
    ear = Ear("/a", "/b")
    assert not any(ear.hear(number) for number in numbers)
    assert 2 <= int(ear.trouble.split()[0]) <= 16
