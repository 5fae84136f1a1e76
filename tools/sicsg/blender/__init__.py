"""What runs inside Blender's Python: imports bpy, numpy and the standard library only.

bpy wants a numpy of its own, so this folder runs in a second environment, as the child of ``rendering/cycles.py``::

    wire       messages over a pipe; both sides import it
    engine     settings of Cycles: one scene for pictures, one for passes
    materials  surfaces and textures
    sky        what lies outside
    stage      meshes, objects and lamps
    camera     a pinhole as Blender's camera
    readback   a render as an array
    studio     the jobs
    worker     reads jobs, writes results
"""
