"""The reference is settled by period numbers alone."""

import numpy as np
import pytest

from microstage_ros.control.trajectories.reference_player import HOLDING, MOVING, STOPPING, ReferencePlayer
from microstage_ros.quantities.errors import InputError


def follow(player, start, positions):
    """As the controller does it."""
    return player.follow(start, player.checked(positions))


@pytest.fixture
def player():
    made = ReferencePlayer(1e-4, 0.008)
    made.at(0, 1e-6)
    return made


def test_holds_where_it_began(player):
    assert player.at(1, 5e-6) == (1e-6, HOLDING)


def test_follows_from_the_stated_period(player):
    ramp = 1e-6 + np.linspace(0.0, 1e-6, 11)
    assert follow(player, 5, ramp) == (5, 15, pytest.approx(2e-6))
    played = [player.at(n, 0.0) for n in range(1, 20)]
    assert [p[0] for p in played] == [1e-6] * 4 + list(ramp) + [ramp[-1]] * 4
    assert [p[1] for p in played][4:14] == [MOVING] * 10 and played[-1][1] == HOLDING


@pytest.mark.parametrize("start, positions, words", [
    (5, [2e-6], "first position"), (5, [1e-6, np.nan], "position 1"), (5, [np.inf], "position 0")])
def test_refuses_steps_and_nonsense(player, start, positions, words):
    with pytest.raises(InputError, match=words):
        follow(player, start, positions)


def test_refuses_the_past_and_a_motion_under_way(player):
    player.at(50, 0.0)
    with pytest.raises(InputError, match="after 50"):
        follow(player, 50, [1e-6])
    follow(player, 60, 1e-6 + np.linspace(0, 1e-3, 1000))
    player.at(100, 0.0)
    with pytest.raises(InputError, match="motion under way"):
        follow(player, 200, [1e-6])


def test_a_plan_that_is_sent_again_is_played_once(player):
    """Its answer was lost: who asks again gets the same one, however far the plan is; another plan is refused."""
    ramp = 1e-6 + np.linspace(0.0, 1e-6, 11)
    first = follow(player, 0, ramp)
    for n in range(1, 11):
        assert follow(player, 0, ramp) == follow(player, first[0], ramp) == first
        player.at(n, 0.0)
    for start, positions in ((0, ramp + 1e-9), (first[0] + 1, ramp), (0, ramp[:-1])):
        with pytest.raises(InputError):
            follow(player, start, positions)
    player.at(11, 0.0)
    with pytest.raises(InputError, match="first position"):  # it has ended: to play it again is another motion
        follow(player, 0, ramp)


def test_a_plan_that_is_stopped_is_not_begun_again(player):
    ramp = 1e-6 + np.linspace(0.0, 1e-3, 1000)
    follow(player, 1, ramp)
    player.at(500, 0.0)
    player.stop()
    with pytest.raises(InputError, match="has begun|motion under way"):
        follow(player, 1, ramp)


def test_stop_is_smooth_within_its_time(player):
    """Velocity falls from v to 0 in 8 ms without a jump; distance v t / 2."""
    speed = 1e-6  # m per period
    follow(player, 1, 1e-6 + speed * np.arange(1001))
    for n in range(1, 501):
        player.at(n, 0.0)
    start, rest, place = player.stop()
    assert (start, rest) == (501, 581)
    track = np.array([player.at(n, 0.0)[0] for n in range(501, 601)])
    steps = np.diff(track)
    assert player.at(550, 0.0)[1] == STOPPING and track[80] == place and (steps[80:] == 0).all()
    assert (np.diff(steps[:80]) <= 1e-20).all() and steps[0] == pytest.approx(speed, rel=0.01)
    assert place - track[0] == pytest.approx(speed * 80 / 2, rel=0.02)


def test_stop_at_rest_stays(player):
    player.at(1, 0.0)
    assert player.stop() == (2, 2, 1e-6)


def test_forgotten_plan_does_not_come_back(player):
    """After an interruption the reference is where the axis is, also if period numbers begin anew."""
    follow(player, 1, 1e-6 + np.linspace(0.0, 1e-3, 1000))
    player.at(500, 0.0)
    player.forget()
    assert player.at(3, 7e-6) == (7e-6, HOLDING) and player.at(600, 9e-6) == (7e-6, HOLDING)


def test_nothing_before_the_first_state():
    player = ReferencePlayer(1e-4, 0.008)
    for call in (lambda: follow(player, 0, [0.0]), player.stop):
        with pytest.raises(InputError, match="no state so far"):
            call()
