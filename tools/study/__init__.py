"""How good must joints, calibration and clocks be? Accuracy of each violation against errors that are injected.

The Safe-Construct paper leaves open "the trade-off between violation recognition accuracy and precision of 3D joint
estimation". Here errors of one kind at a time are injected into exact worlds, and everything after them is the real
thing: the rig file's rig, :class:`recognition.placing.Placer`, the rules, and the figures of
:mod:`recognition.evaluation.violations`. Workers, objects and violations are known at any time from the scene file, and
what hides them from each camera from the truth beside the sequence; scenes that nobody rendered take part as well.

    python -m tools.study all SEQUENCES --rules rig_configs/site.rules.toml --out out/study
    python -m tools.evaluation_report out/evaluation.json -o out/evaluation --study out/study

Each command adds lines to a file in ``OUT`` and passes over those that are there, so that it goes on where it was
stopped; what the networks saw, and the truth of scenes without pictures, stay in ``OUT`` for other rules.

    world       a sequence's world at any time
    unrendered  sequences without pictures
    exact       what the lenses see of a world
    errors      how the networks err, measured
    measured    a detector that errs so
    detector    detectors that see what shows, or through everything
    faults      the errors: of joints, calibration, clocks, and joints that are not known
    trial       one error, one seed, one sequence: from the world to decisions
    compress    videos encoded again, looked at by the networks
    safe        false alarms in hours of safe work
    figures     lines to curves, and limits that an error may reach
    gates       what the curves say of rigcal's gates
    plot        curves as SVG
"""
