"""Clocks from people who move: 2D joints without identity, matched by epipolar geometry."""

from rigcal.sync.content.people.keypoints import Keypoints, read_keypoints
from rigcal.sync.content.people.lags import PeopleOptions, people_lags

__all__ = ["Keypoints", "PeopleOptions", "people_lags", "read_keypoints"]
