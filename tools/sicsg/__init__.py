"""SICSG: the synthetic indoor construction site generator (Safe-Construct, section "Synthetic Scene Creation").

One seed gives one scene. A scene is a file (``scene.py``) that names assets and says who does what when; everything
else follows from it: meshes, motion, images, truth. The rooms of this house, in import order::

    assets      names of bodies, clothes, textures, variants; which of them are sealed for the test half
    mesh        triangles with materials, what both renderers draw
    scene       the scene file
    textures    image textures by name
    catalog     the object categories, one file; objects/ makes their meshes
    skeleton    bones and COCO-17 joints of a worker
    workers/    bodies, clothes, skinning, motion
    rooms/      rooms, clutter and light rigs
    story       who does what when, and which violations follow from it
    moment      a scene at one time, as instances
    rendering/  the fast path (OpenGL) and the path tracer (Cycles); the sensor
    truth       joints, boxes, visibility; export
"""
