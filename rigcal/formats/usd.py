"""OpenUSD's cameras as text, ``.usda``, for Blender, Omniverse and renderers; export only.

Each camera is a prim with ``xformOp:transform``, a matrix of row vectors that maps points of the camera into the
scene, in metres with z up; the camera looks along -z with y up. ``focalLength`` and the apertures are in tenths of a
scene unit; the vertical aperture holds fx and fy apart, the aperture offsets the principal point. USD has no lens
distortion, and its camera numbers are single precision: a renderer sees a pinhole. So that nothing is lost, the rig's
own model and coefficients stand beside it in double precision as ``rigcal:`` attributes. Other programs' USD
cameras have no pixels, so none are imported.
"""

from __future__ import annotations

from rigcal.formats._foreign import GL_FROM_CV, Written, cams_from_upright
from rigcal.formats._yaml import quoted
from rigcal.geometry import Pose
from rigcal.rig import Rig, RigCamera

NAME = "usd"
_APERTURE_TENTHS = 0.36
"""Width of a full-frame sensor, 36 mm, in tenths of a metre; only its ratio to the focal length matters."""
_HALF_PIXEL = 0.5
_HEADER = """#usda 1.0
(
    defaultPrim = "Rig"
    metersPerUnit = 1
    upAxis = "Z"
)

def Xform "Rig"
{
"""


def write(rig: Rig) -> Written:
    """Write the cameras in metres with z up, in the world frame where the rig has one; nothing is refused."""
    poses, frame = cams_from_upright(rig)
    prims = [_prim(n, camera, pose.inverse()) for n, (camera, pose) in enumerate(zip(rig.cameras, poses, strict=True))]
    named = ", ".join(f"camera_{n} is {camera.id}" for n, camera in enumerate(rig.cameras))
    conventions = (
        f"cameras: {named}",
        f"poses: xformOp:transform maps points of the camera into the scene (row vectors), {frame}",
        "axes: the camera is OpenGL's, x right, y up, z back; the scene has z up",
        "lengths: metres; focal length and apertures in tenths of a metre, single precision",
        "lens: USD renders a pinhole without distortion; every coefficient stands in rigcal:coefficients",
        "pixels: apertures and offsets are of the image's borders; rigcal:coefficients have (0, 0) at a pixel's centre",
    )
    return Written(_HEADER + "\n".join(prims) + "}\n", conventions)


def _prim(number: int, camera: RigCamera, scene_from_cam: Pose) -> str:
    lens = camera.camera
    (width, height), (fx, fy, cx, cy) = lens.size_wh, lens.params[:4].tolist()
    tenths_per_px_u = _APERTURE_TENTHS / width
    tenths_per_px_v = tenths_per_px_u * fx / fy
    rows = tuple(map(tuple, (scene_from_cam @ GL_FROM_CV).matrix.T.tolist()))
    lines = (
        f"float focalLength = {fx * tenths_per_px_u!r}",
        f"float horizontalAperture = {_APERTURE_TENTHS}",
        f"float verticalAperture = {height * tenths_per_px_v!r}",
        f"float horizontalApertureOffset = {(width / 2 - (cx + _HALF_PIXEL)) * tenths_per_px_u!r}",
        f"float verticalApertureOffset = {(cy + _HALF_PIXEL - height / 2) * tenths_per_px_v!r}",
        f"matrix4d xformOp:transform = {rows}",
        'uniform token[] xformOpOrder = ["xformOp:transform"]',
        f"custom string rigcal:id = {quoted(camera.id)}",
        f"custom int2 rigcal:size_wh = ({width}, {height})",
        f"custom string rigcal:model = {quoted(lens.model)}",
        f"custom string[] rigcal:coefficientNames = [{', '.join(map(quoted, lens.names))}]",
        f"custom double[] rigcal:coefficients = {lens.params.tolist()}",
    )
    return f'    def Camera "camera_{number}"\n    {{\n' + "".join(f"        {line}\n" for line in lines) + "    }\n"
