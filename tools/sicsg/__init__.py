"""SICSG: the synthetic indoor construction site generator (Safe-Construct, section "Synthetic Scene Creation").

One seed gives one scene. A scene is a file (``scene.py``) that names assets and says who does what when; everything
else follows from it: meshes, motion, images, truth. The rooms of this house, in import order::

    assets          names of bodies, clothes, textures, variants; which of them are sealed for the test half
    mesh, shapes    triangles with materials, what both renderers draw; boxes, tubes and the like
    scene           the scene file
    textures        image textures by name
    catalog         the object categories, one file; objects/ makes their meshes
    skeleton        bones and COCO-17 joints of a worker
    workers/        bodies, clothes, skinning; motion, and what feet and hands touch
    rooms/          rooms and clutter; lighting and cameras stand beside it
    story/          who does what when; violations says which violations follow from it
    moment          a scene at one time, as instances
    rendering/      the fast path (OpenGL), the path tracer (Cycles, through blender/), lens and sensor
    truth           joints, boxes, keypoints and what hides them
    photograph      pictures with their truth
    coco, dataset   training data
    sequences       evaluation sequences; planning chooses them, scenes/ holds their scene files
    demo/           the demo site
"""
