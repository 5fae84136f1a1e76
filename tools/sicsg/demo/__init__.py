"""The demo site: what a technician and an operator would bring home from a simulated site, with its truth.

::

    FOLDER/boards/cam0.mp4 ...      the calibration board held still in many places of the empty room
    FOLDER/boards/timestamps.csv    stamps of each camera's own clock
    FOLDER/floor/cam0.mp4 ...       the board lying on the floor, its first corner at the world's origin at first
    FOLDER/clock_probes.csv         a log of ``rigcal sync probe``: what the cameras' hosts said of the time
    FOLDER/work/                    28 seconds of work with their truth, as ``tools.sicsg.sequences`` has it

The rooms of this house, in import order::

    scene     who is there: the shift's scene, its cameras and their clocks
    painting  a board into a camera's picture
    places    where the board is held, and when
    boards    the videos of the board and the pictures of the floor
    probes    the probe log
    work      the work sequence, an instant at a time
    make      all of it
"""
