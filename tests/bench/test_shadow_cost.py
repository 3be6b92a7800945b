"""What an episode's shadows cost, told from three commands."""

from tools.bench import shadow_cost
from tools.bench.shadow_cost import EpisodeSeconds


def test_episodes_and_copies_are_told_from_three_commands() -> None:
    start, episode, copy = 2.0, 3.0, 0.5  # an episode's seconds are with its first copy
    more = (shadow_cost.COPIES - 1) * copy
    several = start + shadow_cost.EPISODES * episode
    found = EpisodeSeconds.of(start + episode, start + episode + more, several)
    assert found == EpisodeSeconds(start + episode, episode, copy)


def test_a_row_says_how_much_more_and_what_was_aimed_for() -> None:
    found = {"robust": {False: EpisodeSeconds(6.0, 4.0, 2.0), True: EpisodeSeconds(9.0, 6.0, 2.5)}}
    (episode, copy, command) = shadow_cost.rows(found)
    assert episode == [
        "robust",
        "an episode with its first copy",
        4.0,
        6.0,
        {"value": 50, "target": "<= 40"},
    ]
    assert copy[-1] == {"value": 25, "target": "<= 40"}
    assert command[2:4] == [6.0, 9.0]
