"""Trains the bundled networks from rendered scenes, exports them to ONNX, measures what they find and packages them.

    python -m tools.train fit --network site --data out/sicsg/train --out out/train/site
    python -m tools.train export --data out/sicsg/train --out out/train/site
    python -m tools.train evaluate --site out/train/site --worker out/train/worker --data out/sicsg/train
    python -m tools.train package --site out/train/site --worker out/train/worker --data out/sicsg/train
    python -m tools.train thresholds --data out/sicsg/train
    python -m tools.train measure --sequences out/sicsg/sequences/test
    python -m tools.train gap
    python -m tools.train saving --all out/train/worker --rules out/train/worker_rules --data out/sicsg/train
    python -m tools.train card

``fit`` and ``export`` need torch and onnx, which have an environment of their own (``constraints.txt``); all else runs
in the project's. What the networks' outputs mean is defined where they are used: ``recognition.detectors.bundled``.
In import order::

    geometry    letterbox, joints of the rules, mirror images
    metrics     average precision, joint similarity
    coco        the data file, checked
    warp        augmentation of places: scale, shift, mirror, turn, two images as one
    cache       decoded images and crops of workers in memory maps
    pixels      augmentation of colours: light, blur, noise, compression, holes
    heads       heads in crops: which are bare, and their augmentation
    networks, assign, losses, samples, lanes, fit, export
    facts       files of figures
    package     the files that the package ships, with their manifests
    predict     the packaged networks over pictures
    evaluate    what they find, against the truth
    thresholds  what counts as found
    sequences, joints3d, measure: evaluation sequences, in pictures and in the world
    gap         real people
    saving      a network of fewer joints
    card        the model card
"""
