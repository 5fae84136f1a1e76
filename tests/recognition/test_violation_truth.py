"""The truth of a sequence: when violations of the scene hold, which instants are transitions, who sees them."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
from violation_scenes import truth, violation, write_truth

from recognition.errors import DatasetError
from recognition.evaluation.violations import KINDS, Stretch, find_sequences, read_scene_truth

NO_HAT, LADDER = KINDS.index("no_hat"), KINDS.index("ladder")


def test_a_violation_holds_from_its_start_to_before_its_end(tmp_path):
    found = read_scene_truth(write_truth(tmp_path / "s", violations=[violation("no_hat", 0.4, 1.0)]))
    assert np.flatnonzero(found.active[:, NO_HAT]).tolist() == [2, 3, 4]
    assert not found.active[:, LADDER].any()
    assert (found.name, found.light, found.split) == ("s", "dusk", "validation")
    assert found.t_ns[1] == 100_200_000_000
    assert found.period_s == pytest.approx(0.2)


def test_bindings_of_one_violation_are_one_violation_of_the_scene(tmp_path):
    given = [violation("no_hat", 0.2, 0.6), violation("no_hat", 0.5, 1.0, ("w1",)), violation("no_hat", 1.4, 1.6)]
    found = read_scene_truth(write_truth(tmp_path / "s", violations=given))
    assert found.stretches[NO_HAT] == (Stretch(0.2, 1.0), Stretch(1.4, 1.6))


def test_instants_within_half_a_second_of_a_start_or_an_end_are_transitions():
    found = truth({"no_hat": [(2.0, 4.0)]})
    near = np.flatnonzero(found.near[:, NO_HAT]) * 0.2
    assert near.min() == pytest.approx(1.6)
    assert near.max() == pytest.approx(4.4)
    assert not found.near[13:17, NO_HAT].any()
    assert not found.near[:, LADDER].any()


def test_what_lasts_from_the_first_instant_or_to_the_last_has_no_transition_there():
    found = truth({"no_hat": [(0.0, 1.0)], "ladder": [(5.0, 6.0)]})
    assert not found.near[0, NO_HAT]
    assert found.near[3:8, NO_HAT].all()
    assert not found.near[-1, LADDER]


def test_how_much_is_hidden_and_how_many_cameras_see_those_who_take_part(tmp_path):
    shown = np.ones((10, 2, 3))
    shown[2:, 0, 0] = 0.1  # camera 0 sees little of worker 0
    shown[4:, 1, 2] = 0.0  # and camera 1 nothing of the ladder
    given = [violation("ladder", 0.0, 2.0, ("w0",), ("ladder-0",))]
    found = read_scene_truth(write_truth(tmp_path / "s", violations=given, shown=shown))
    assert found.seen_by[:, LADDER].tolist() == [2, 2, 1, 1, 0, 0, 0, 0, 0, 0]
    assert (found.seen_by[:, NO_HAT] == -1).all()
    assert found.hidden[0] == 0.0
    assert found.hidden[5] == pytest.approx(0.9 / 4)


@pytest.mark.parametrize(
    ("changed", "what"),
    [
        ({"format": "other"}, "the truth has another form"),
        ({"violations": [violation("fire", 0, 1)]}, "the truth has another form"),
        ({"violations": [violation("no_hat", 1, 1)]}, "the truth has another form"),
        ({"violations": [violation("no_hat", 0, 1, ("nobody",))]}, "names nobody of the scene"),
        ({"instants_s": [0.0, 0.0]}, "instants_s does not ascend"),
        ({"workers": ["w0"]}, "pixels have another shape"),
    ],
)
def test_a_truth_of_another_form_is_refused(tmp_path, changed, what):
    folder = write_truth(tmp_path / "s", **({"violations": []} | changed))
    with pytest.raises(DatasetError, match=what):
        read_scene_truth(folder)


def test_files_that_cannot_be_read_are_named(tmp_path):
    folder = write_truth(tmp_path / "s", violations=[])
    (folder / "truth.npz").write_bytes(b"no archive")
    with pytest.raises(DatasetError, match=r"truth\.npz"):
        read_scene_truth(folder)
    (folder / "truth.json").write_text("{")
    with pytest.raises(DatasetError, match=r"truth\.json"):
        read_scene_truth(folder)


def test_sequences_are_found_in_a_half_a_folder_or_alone(tmp_path):
    for split in ("validation", "test"):
        for name in ("b", "a"):
            folder = tmp_path / split / name
            folder.mkdir(parents=True)
            (folder / "truth.json").write_text(json.dumps({}))
    half = tmp_path / "validation"
    assert find_sequences(tmp_path, "validation") == (half / "a", half / "b")
    assert find_sequences(half, "validation") == (half / "a", half / "b")
    assert find_sequences(half / "b", "validation") == (half / "b",)
    with pytest.raises(DatasetError, match="there is no sequence"):
        find_sequences(tmp_path / "nothing", "validation")
