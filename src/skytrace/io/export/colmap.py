"""COLMAP text model: cameras.txt, images.txt and points3D.txt in a folder.

Once the clocks are known, a moving target seen at many moments is a static scene of many points.
"""

from __future__ import annotations

import numpy as np

from skytrace.geometry.arrays import FloatArray
from skytrace.io.export.content import ExportCamera, ExportRun, Format

_COLOUR = "255 165 0"
_PIXEL_CENTRE = 0.5  # COLMAP's coordinates of the centre of the top-left pixel
_NO_ERROR = "-1"  # how COLMAP writes a reprojection error that was not computed


def write_colmap(run: ExportRun) -> dict[str, str]:
    """The texts of the three files. A camera is one image; a sample of the track is one point.

    Points have no observations: a run does not keep its detections.
    """
    cameras = ["# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]"]
    images = ["# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME", "# POINTS2D[] as (X, Y, POINT3D_ID)"]
    for index, camera in enumerate(run.cameras.values(), 1):
        cameras.append(f"{index} {_lens(camera)}")
        pose = camera.camera_from_frame
        numbers = " ".join(repr(v) for v in [*quaternion_wxyz(pose.rotation).tolist(), *pose.translation.tolist()])
        # White space would end the name.
        images += [f"{index} {numbers} {index} {index:02d}_{'_'.join(camera.camera_id.split())}.png", ""]
    points = [
        f"# frame: {' '.join(run.frame.split())}; unit: {run.unit}",
        "# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[]",
    ]
    for index, (x, y, z) in enumerate(run.position.tolist(), 1):
        points.append(f"{index} {x:.9g} {y:.9g} {z:.9g} {_COLOUR} {_NO_ERROR}")
    files = {"cameras.txt": cameras, "images.txt": images, "points3D.txt": points}
    return {name: "\n".join(lines) + "\n" for name, lines in files.items()}


def _lens(camera: ExportCamera) -> str:
    lens = camera.intrinsics
    width, height = lens.size_px
    numbers = [*lens.focal_px.tolist(), *(lens.principal_px + _PIXEL_CENTRE).tolist(), *lens.distortion.tolist()]
    if lens.model == "pinhole":
        # COLMAP's rational model with no denominator; its OPENCV model has no k3.
        return f"FULL_OPENCV {width} {height} {' '.join(map(repr, numbers))} 0 0 0"
    return f"OPENCV_FISHEYE {width} {height} {' '.join(map(repr, numbers))}"


def quaternion_wxyz(rotation: FloatArray) -> FloatArray:
    """The unit quaternion (4,) w x y z, w >= 0, of a rotation matrix (3, 3).

    Four times its outer product with itself is linear in the matrix; the row with the largest diagonal is the best
    conditioned (Bar-Itzhack, "New method for extracting the quaternion from a rotation matrix", JGCD 2000).
    """
    R = np.asarray(rotation, float)
    product = np.array(
        [
            [1 + R[0, 0] + R[1, 1] + R[2, 2], R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]],
            [R[2, 1] - R[1, 2], 1 + R[0, 0] - R[1, 1] - R[2, 2], R[0, 1] + R[1, 0], R[0, 2] + R[2, 0]],
            [R[0, 2] - R[2, 0], R[0, 1] + R[1, 0], 1 - R[0, 0] + R[1, 1] - R[2, 2], R[1, 2] + R[2, 1]],
            [R[1, 0] - R[0, 1], R[0, 2] + R[2, 0], R[1, 2] + R[2, 1], 1 - R[0, 0] - R[1, 1] + R[2, 2]],
        ]
    )
    row = product[np.argmax(np.diag(product))]
    q = row / np.linalg.norm(row)
    return q if q[0] >= 0 else -q


FORMAT = Format("colmap", "", "folder with cameras.txt, images.txt, points3D.txt", write_colmap, rate_hz=10.0)
