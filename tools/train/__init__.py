"""Trains the bundled networks from rendered scenes, exports them to ONNX and measures what they find.

    python -m tools.train fit --network site --data out/sicsg/train --out out/train/site
    python -m tools.train export --network site --data out/sicsg/train --out out/train/site
    python -m tools.train evaluate --site site.onnx --worker worker.onnx --data out/sicsg/train

Only ``networks``, ``assign``, ``losses``, ``samples``, ``fit`` and ``export`` need torch and onnx, which have an
environment of their own; the rest is NumPy and OpenCV. In import order::

    geometry    coordinates: letterbox, the worker's crop, joints and their mirror images
    decode      from the networks' outputs to detections: the definition of the outputs
    metrics     average precision, joint similarity
    coco        the data file, checked
    warp        augmentation of places: scale, shift, mirror, turn, two images as one
    cache       decoded images and crops of workers in memory maps
    pixels      augmentation of colours: light, blur, noise, compression, holes
    networks, assign, losses, samples, lanes, fit, export
    evaluate    the exported networks against the truth
"""
