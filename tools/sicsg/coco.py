"""Training data: COCO JSON of persons with joints and objects with keypoints.

Beyond COCO's own entries an annotation has ``visible_fraction``, ``thing`` (its id in the scene),
``ignore`` (1: too small or too hidden to be asked for) and ``worn_by`` (annotation of the worker who wears or carries
it); an image has ``scene``, ``camera``, ``light`` and ``renderer``. Keypoints of objects are in the order that
``catalog.canonical_order`` gives for the image. Boxes are [x, y, width, height] with edges half a pixel outside the
outermost pixels' centres; pixel (0, 0) is the centre of the top-left pixel.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tools.sicsg.catalog import CATEGORIES, canonical_order
from tools.sicsg.photograph import Picture
from tools.sicsg.skeleton import JOINTS
from tools.sicsg.truth import PersonTruth, ThingTruth, Visibility

PERSON_MIN_HEIGHT, THING_MIN_SIDE = 20 / 720, 5 / 720
"""Least height of a person's box and least side of an object's, over the image's height; smaller ones are ignored."""
MIN_VISIBLE = 0.15
"""What shows less of itself is ignored."""


def categories() -> list[dict[str, Any]]:
    """COCO's categories: person is 1, the catalogue follows."""
    people = {"id": 1, "name": "person", "keypoints": list(JOINTS)}
    things = [{"id": k, "name": c.name, "keypoints": list(c.keypoints)} for k, c in enumerate(CATEGORIES, start=2)]
    return [people, *things]


_NUMBER = {category.name: index for index, category in enumerate(CATEGORIES, start=2)}


def annotations(picture: Picture) -> list[dict[str, Any]]:
    """Annotations of a picture, numbered from 0; ``image_id`` is left to the caller."""
    found: list[dict[str, Any]] = []
    place = {}
    for person in picture.people:
        if person.box is not None:
            place[person.id] = len(found)
            found.append(_entry(picture, person, 1, person.joints_px, person.visibility) | {"worn_by": None})
    for thing in picture.things:
        if thing.box is not None:
            # Points behind the camera have no pixels, so there is nothing to order by: they are labelled as absent.
            seen_whole = len(thing.keypoints_px) and np.isfinite(thing.keypoints_px).all()
            whole = list(range(len(thing.keypoints_px)))
            order = list(canonical_order(thing.category, thing.keypoints_px)) if seen_whole else whole
            entry = _entry(picture, thing, _NUMBER[thing.category], thing.keypoints_px[order], thing.visibility[order])
            found.append(entry | {"worn_by": place.get(thing.worn_by or "")})
    return [entry | {"id": index} for index, entry in enumerate(found)]


def _entry(
    picture: Picture, what: PersonTruth | ThingTruth, category: int, points_px: NDArray[Any], seen: NDArray[Any]
) -> dict[str, Any]:
    box = np.asarray(what.box)
    size = box[2:] - box[:2]
    share = min(what.pixels / max(picture.full_pixels[what.id], 1), 1.0)
    height = picture.image_bgr.shape[0]
    too_small = size[1] < PERSON_MIN_HEIGHT * height if category == 1 else size.min() < THING_MIN_SIDE * height
    flags = np.where(seen == Visibility.VISIBLE, 2, np.where(seen == Visibility.OUTSIDE, 0, 1))
    triples = np.column_stack([np.where(flags[:, None] > 0, points_px, 0.0), flags]) if len(flags) else np.zeros((0, 3))
    return {
        "category_id": category,
        "bbox": [round(float(value), 2) for value in (*box[:2], *size)],
        "area": what.pixels,
        "visible_fraction": round(share, 3),
        "iscrowd": 0,
        "ignore": int(too_small or share < MIN_VISIBLE),
        "keypoints": [round(float(value), 2) for value in triples.ravel()],
        "num_keypoints": int((flags > 0).sum()),
        "thing": what.id,
    }
