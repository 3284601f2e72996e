"""Scores of an embedder that distinguishes people in a set of pictures; needs no PyTorch.

The embedder can be any implementation of perception's `Embedder`: an ONNX file, or the stripes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from passerby.common.arrays import Floats, Ints
from passerby.common.errors import InputError
from passerby.common.progress import Progress, silent
from passerby.core.observations import Vectors
from passerby.evaluation.retrieval import RANKS, RetrievalScore, retrieval_score
from passerby.perception.pictures import Embedder, Picture
from passerby.training.crops import UNKNOWN_CAMERA, CropSet, DataSet, read_picture

Embed = Callable[[CropSet], Vectors]
"""Function that returns the vectors (N, D) of a set's pictures."""

STAGE = "embedding"
TOLD_EVERY = 64
"""Number of pictures between two reports of progress."""
NOTHING = 1e-6
"""A vector shorter than this has no direction."""


def make_full_box(picture: Picture) -> Floats:
    """Return the box (1, 4) that is exactly the whole picture after the rounding of `perception.crop_network.stretch_crop`.

    In this package's coordinates a picture begins half a pixel before (0, 0). But half a pixel is rounded to the next even
    number, so a box from there would lose the last column of each picture with an odd width.
    """
    height, width = picture.shape[:2]
    return np.array([[0.0, 0.0, width, height]])


def embed_crops(crops: CropSet, embedder: Embedder, tell: Progress = silent) -> Vectors:
    """Compute unit vectors (N, D) of a set's whole pictures; zeros for a picture without a result.

    Raises `InputError` for a picture that cannot be read.
    """
    vectors = np.zeros((len(crops), embedder.dimensions), dtype=np.float32)
    for row, path in enumerate(crops.paths):
        if row % TOLD_EVERY == 0:
            tell(STAGE, row, len(crops))
        picture = read_picture(path)
        vectors[row] = embedder(picture, make_full_box(picture))[0]
    tell(STAGE, len(crops), len(crops))
    return vectors


def score_crops(
    query: CropSet,
    gallery: CropSet,
    query_vectors: Vectors,
    gallery_vectors: Vectors,
    centred: bool = False,
    ranks: Sequence[int] = RANKS,
) -> RetrievalScore:
    """Compute CMC and mAP by the Market-1501 protocol (see `evaluation.retrieval`) and the cosine distance.

    Args:
        query: Q pictures of people to search for.
        gallery: G pictures that are searched; people and cameras are matched by name. If a set's cameras are unknown, no two
            pictures count as of the same camera.
        query_vectors: (Q, D) vectors.
        gallery_vectors: (G, D) vectors.
        centred: first subtract each camera's mean, over its pictures in both, as association does with the tracklets of a
            camera (`association.appearance.without_camera_bias`).
        ranks: the k of rank-k.

    Raises `InputError` as `retrieval_score`, and for vectors that do not fit the pictures.
    """
    person, camera, known = _number_alike(query, gallery)
    n = len(query)
    vectors = _directions(query, gallery, query_vectors, gallery_vectors, camera, centred)
    return retrieval_score(
        _cosine(vectors[:n], vectors[n:]),
        person[:n],
        np.where(known[:n], camera[:n], -1),
        person[n:],
        np.where(known[n:], camera[n:], -2),
        ranks,
        apart=_find_distinct(query, gallery),
    )


def leave_one_out(crops: CropSet, vectors: Vectors, centred: bool = False, ranks: Sequence[int] = RANKS) -> RetrievalScore:
    """Compute CMC and mAP if each picture of a person searches all pictures of the other cameras.

    With one camera, or with unknown cameras, it searches all other pictures.

    Args:
        crops: N pictures; people who may be the same person (`CropSet.apart`) count neither as right nor as wrong.
        vectors: (N, D) vectors.
        centred: as in `score_crops`.
        ranks: the k of rank-k.

    Raises `InputError` as `score_crops`.
    """
    person, camera, known = _number_alike(crops, CropSet())
    unit = _directions(crops, CropSet(), vectors, vectors[:0], camera, centred)
    if not known.all() or len(np.unique(camera)) < 2:
        camera = np.arange(len(crops))  # a separate camera for each picture, so that only the picture itself is ignored
    rows = np.flatnonzero(person >= 0)
    return retrieval_score(
        _cosine(unit[rows], unit), person[rows], camera[rows], person, camera, ranks, across=True, apart=crops.apart
    )


def score_data(data: DataSet, embed: Embed, centred: bool = False, ranks: Sequence[int] = RANKS) -> RetrievalScore:
    """Compute the score of a data set: of its query in its gallery, or of its training people by `leave_one_out`.

    Raises `InputError` as `score_crops` and `leave_one_out`.
    """
    if len(data.query):
        return score_crops(data.query, data.gallery, embed(data.query), embed(data.gallery), centred, ranks)
    return leave_one_out(data.train, embed(data.train), centred, ranks)


def _number_alike(query: CropSet, gallery: CropSet) -> tuple[Ints, Ints, NDArray[np.bool_]]:
    """Return people and cameras of query and gallery, (Q + G,) each, with common numbers, and whether the camera is known."""
    people = {name: row for row, name in enumerate(dict.fromkeys((*query.people, *gallery.people)))}
    cameras = {name: row for row, name in enumerate(dict.fromkeys((*query.cameras, *gallery.cameras)))}
    person, camera = [], []
    for crops in (query, gallery):
        rows = np.array([*(people[name] for name in crops.people), -2, -1], dtype=np.int64)
        person.append(rows[crops.person])  # -1 and -2 do not change
        camera.append(np.array([cameras[name] for name in crops.cameras], dtype=np.int64)[crops.camera])
    known = np.array([not name.endswith(f"/{UNKNOWN_CAMERA}") for name in cameras], dtype=np.bool_)
    every = np.concatenate(camera)
    return np.concatenate(person), every, known[every]


def _find_distinct(query: CropSet, gallery: CropSet) -> NDArray[np.bool_] | None:
    """Return whether two people, numbered as by `_number_alike`, are known to be different, (P, P); None if all are."""
    if query.apart is None and gallery.apart is None:
        return None
    people = {name: row for row, name in enumerate(dict.fromkeys((*query.people, *gallery.people)))}
    apart = ~np.eye(len(people), dtype=np.bool_)
    for crops in (query, gallery):
        if crops.apart is not None:
            rows = np.array([people[name] for name in crops.people], dtype=np.int64)
            apart[np.ix_(rows, rows)] &= crops.apart
    return apart


def _directions(
    query: CropSet, gallery: CropSet, query_vectors: Vectors, gallery_vectors: Vectors, camera: Ints, centred: bool
) -> Vectors:
    """Return unit vectors (Q + G, D), on request after subtraction of their camera's mean; zero vectors stay zero."""
    for crops, vectors in ((query, query_vectors), (gallery, gallery_vectors)):
        if np.ndim(vectors) != 2 or len(vectors) != len(crops) or vectors.shape[1] != query_vectors.shape[1]:
            shapes = f"{np.shape(query_vectors)} and {np.shape(gallery_vectors)}"
            raise InputError(f"vectors of the shapes {shapes} for {len(query)} and {len(gallery)} images: one each is needed")
    unit = _unit(np.concatenate([query_vectors, gallery_vectors]))
    if not centred:
        return unit
    for number in np.unique(camera):
        rows = (camera == number) & (unit != 0).any(axis=1)
        if rows.any():
            unit[rows] -= unit[rows].mean(axis=0, dtype=np.float64)
    return _unit(unit)


def _unit(vectors: Vectors) -> Vectors:
    """Scale vectors (N, D) to length one, float32; vectors shorter than `NOTHING` become zero."""
    given = np.asarray(vectors, dtype=np.float64)
    length = np.linalg.norm(given, axis=1, keepdims=True)
    return np.where(length > NOTHING, given / np.maximum(length, NOTHING), 0.0).astype(np.float32)


def _cosine(query: Vectors, gallery: Vectors) -> Callable[[int, int], Vectors]:
    """Return a function that computes rows of the cosine distances (Q, G), so that not all of them need be in memory."""
    return lambda low, high: np.asarray(1.0 - query[low:high] @ gallery.T, dtype=np.float32)
