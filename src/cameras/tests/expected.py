#!/usr/bin/env python3
"""Makes the calibrations of this folder, and the pixels to which their own software brings rays (expected.csv).

    python3 -m venv venv && venv/bin/pip install opencv-python-headless pycolmap numpy && venv/bin/python expected.py

OpenCV and COLMAP are asked themselves. OpenSfM, Metashape, Pix4D and Australis are their published formulas, written down
here once more and, where they go from the image to the ray, inverted numerically. Inpho is what is taken for its formula.
"""
import json
import pathlib

import cv2
import numpy as np
import pycolmap

HERE = pathlib.Path(__file__).parent
ROWS = []


def rays(width, height, focal, number=12, share=0.47):
    random = np.random.default_rng(number)
    return random.uniform(-share, share, (number, 2)) * [width / focal, height / focal]


def note(file, camera, ideal, pixels):
    for (x, y), (u, v) in zip(ideal, pixels):
        ROWS.append(f"{file},{camera},{float(x)!r},{float(y)!r},{float(u)!r},{float(v)!r}")


def opencv():
    cases = {
        "opencv.yaml": (4000, 3000, [-0.0468, 0.0207, 0.00102, -0.00199, 0.0011]),
        "opencv.json": (4000, 3000, [-0.12, 0.06, 0.0005, 0.0002]),
        "opencv.xml": (4000, 3000, [-0.05, 0.02, 0.0003, -0.0002, 0.004, 0.006, 0.003, -0.001]),
        "opencv_prism.yaml": (4000, 3000, [-0.04, 0.02, 0.0003, -0.0002, 0.001, 0, 0, 0, 0.0005, -0.0001, 0.0004, 0.0002]),
        "opencv_tilt.yaml": (4000, 3000, [-0.04, 0.02, 0.0003, -0.0002, 0.001, 0, 0, 0, 0, 0, 0, 0, 0.002, -0.001]),
    }
    for file, (width, height, coefficients) in cases.items():
        matrix, vector = np.array([[2890.5, 0, 2010.25], [0, 2889.0, 1490.75], [0, 0, 1.0]]), np.array([coefficients])
        storage = cv2.FileStorage(str(HERE / file), cv2.FILE_STORAGE_WRITE)
        storage.write("image_width", width)
        storage.write("image_height", height)
        storage.write("camera_matrix", matrix)
        storage.write("distortion_coefficients", vector)
        storage.release()
        ideal = rays(width, height, 2890)
        points = np.column_stack([ideal, np.ones(len(ideal))])
        pixels = cv2.projectPoints(points, np.zeros(3), np.zeros(3), matrix, vector)[0].reshape(-1, 2)
        # OpenCV counts from the centre of the first pixel
        note(file, "", ideal, pixels + 0.5)


def colmap():
    models = {
        "SIMPLE_PINHOLE": [3100.5, 2012.5, 1488.25], "PINHOLE": [3100.5, 3098.0, 2012.5, 1488.25],
        "SIMPLE_RADIAL": [3100.5, 2012.5, 1488.25, -0.07], "RADIAL": [3100.5, 2012.5, 1488.25, -0.07, 0.03],
        "OPENCV": [3100.5, 3098.0, 2012.5, 1488.25, -0.07, 0.03, 0.0012, -0.0007],
        "FULL_OPENCV": [3100.5, 3098.0, 2012.5, 1488.25, -0.06, 0.03, 0.0012, -0.0007, 0.002, 0.01, 0.004, 0.001],
    }
    lines = ["# Camera list with one line of data per camera:", "#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]"]
    for number, (model, parameters) in enumerate(models.items(), 1):
        camera = pycolmap.Camera(camera_id=number, model=model, width=4000, height=3000, params=parameters)
        lines.append(" ".join([str(number), model, "4000", "3000", *map(repr, parameters)]))
        ideal = rays(4000, 3000, 3100)
        points = np.column_stack([ideal, np.ones(len(ideal))])
        note("cameras.txt", number, ideal, camera.img_from_cam(points))
    lines.append("7 OPENCV_FISHEYE 4000 3000 3100 3100 2000 1500 0.1 0 0 0")
    (HERE / "cameras.txt").write_text("\n".join(lines) + "\n")


def brown(x, y, k, p1, p2):
    """x', y' with the tangential terms as OpenCV has them."""
    r2 = x * x + y * y
    radial = 1 + sum(value * r2 ** (power + 1) for power, value in enumerate(k))
    return x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x), y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y


def opensfm():
    cameras = {
        "v2 a 5472 3648 brown 0.6666": {"projection_type": "brown", "width": 1368, "height": 912, "focal_x": 0.6671, "focal_y": 0.6664,
                                        "c_x": -0.0015, "c_y": 0.0047, "k1": -0.264, "k2": 0.1018, "p1": 0.00073, "p2": 0.00026, "k3": -0.0258},
        "v2 b 4000 3000 perspective 0.9": {"projection_type": "perspective", "width": 4000, "height": 3000, "focal": 0.88, "k1": -0.03, "k2": 0.01},
        "v2 c fisheye": {"projection_type": "fisheye", "width": 4000, "height": 3000, "focal": 0.5, "k1": 0.0, "k2": 0.0},
    }
    (HERE / "cameras.json").write_text(json.dumps(cameras, indent=4) + "\n")
    for name, camera in list(cameras.items())[:2]:
        width, height = camera["width"], camera["height"]
        focal_x, focal_y = camera.get("focal_x", camera.get("focal")), camera.get("focal_y", camera.get("focal"))
        ideal = rays(width, height, focal_x * width)
        x, y = brown(*ideal.T, [camera["k1"], camera["k2"], camera.get("k3", 0)], camera.get("p1", 0), camera.get("p2", 0))
        # opensfm.features.denormalized_image_coordinates: pixels from the centre of the first one
        u = (focal_x * x + camera.get("c_x", 0)) * max(width, height) + (width - 1) / 2
        v = (focal_y * y + camera.get("c_y", 0)) * max(width, height) + (height - 1) / 2
        note("cameras.json", name, ideal, np.column_stack([u, v]) + 0.5)


def metashape():
    width, height, f, cx, cy, b1, b2 = 5472, 3648, 3648.25, -12.5, 20.125, -1.75, 0.625
    for file, k, p in [("metashape.xml", [-0.262, 0.105, -0.027], [0.0008, -0.0004]),
                       ("metashape_k4.xml", [-0.062, 0.045, -0.027, 0.006], [0.0008, -0.0004, 0.1, -0.05])]:
        names = [f"k{n + 1}" for n in range(len(k))] + [f"p{n + 1}" for n in range(len(p))]
        values = "".join(f"  <{name}>{value!r}</{name}>\n" for name, value in zip(names, k + p))
        (HERE / file).write_text(f"""<?xml version="1.0" encoding="UTF-8"?>
<calibration>
  <projection>frame</projection>
  <width>{width}</width>
  <height>{height}</height>
  <f>{f}</f>
  <cx>{cx}</cx>
  <cy>{cy}</cy>
  <b1>{b1}</b1>
  <b2>{b2}</b2>
{values}  <date>2026-05-01T10:00:00Z</date>
</calibration>
""")
        ideal = rays(width, height, f)
        x, y = ideal.T
        r2 = x * x + y * y
        radial = 1 + sum(value * r2 ** (power + 1) for power, value in enumerate(k))
        more = 1 + (p[2] * r2 + p[3] * r2**2 if len(p) > 2 else 0)
        xd = x * radial + (p[0] * (r2 + 2 * x * x) + 2 * p[1] * x * y) * more
        yd = y * radial + (p[1] * (r2 + 2 * y * y) + 2 * p[0] * x * y) * more
        note(file, "", ideal, np.column_stack([width / 2 + cx + xd * f + xd * b1 + yd * b2, height / 2 + cy + yd * f]))


def pix4d():
    f, px, py, k, t = 15.01175, 8.4821, 6.33435, [0.03833, -0.0175, 0.0205], [0.0024, 0.0029]
    sensor, size = (17.49998592, 13.12498944), (4608, 3456)
    (HERE / "pix4d.cam").write_text(f"""Pix4D camera calibration file 0
#Focal Length mm assuming a sensor width of {sensor[0]}x{sensor[1]}mm
F {f}
#Principal Point mm
Px {px}
Py {py}
#Symmetrical Lens Distortion Coeffs
K1 {k[0]}
K2 {k[1]}
K3 {k[2]}
#Tangential Lens Distortion Coeffs
T1 {t[0]}
T2 {t[1]}
""")
    per_mm = size[0] / sensor[0]
    ideal = rays(*size, f * per_mm)
    x, y = brown(*ideal.T, k, *t)
    note("pix4d.cam", "", ideal, np.column_stack([f * x + px, f * y + py]) * per_mm)


def australis():
    width, height, pixel = 11608, 8708, 0.0046
    c, xp, yp = 51.6829, 0.0213, -0.0415
    k, p, b = [1.45693931767e-5, -4.0590362e-9, 4.11e-13], [3.43e-6, 4.36e-6], [8.2e-5, -2.1e-5]
    values = [("C", c), ("XP", xp), ("YP", yp), *zip(["K1", "K2", "K3", "P1", "P2", "B1", "B2"], k + p + b)]
    lines = "\n".join(f"   {name:>2}   {0.9 * value:.6e}   {0.1 * value:.6e}   {value!r}   1.0e+003   5.3e-003" for name, value in values)
    (HERE / "australis.txt").write_text(f"""Australis Bundle Adjustment Results: Camera Parameters

Results for Camera 1    iXU-RS1000    Lens 50 mm

Sensor Size        Pixel Size (mm)
  H    {width}           {pixel}
  V    {height}            {pixel}

  Camera    Initial      Total          Final        Initial         Final
 Variable    Value     Adjustment       Value       Std. Error     Std. Error

{lines}

Maximum Observational Radial Distance Encountered:      33.0 mm
""")

    def corrected(x, y):
        r2 = x * x + y * y
        radial = k[0] * r2 + k[1] * r2**2 + k[2] * r2**3
        return np.array([x + x * radial + p[0] * (r2 + 2 * x * x) + 2 * p[1] * x * y + b[0] * x + b[1] * y,
                         y + y * radial + p[1] * (r2 + 2 * y * y) + 2 * p[0] * x * y])

    ideal = rays(width, height, c / pixel)
    pixels = []
    for ray in ideal:
        # photogrammetric y is up, and so is the corrected image of a ray
        wanted = c * ray * [1, -1]
        measured = wanted.copy()
        for _ in range(200):
            measured = measured + (wanted - corrected(*measured))
        assert np.abs(wanted - corrected(*measured)).max() < 1e-12
        pixels.append([width / 2 + (measured[0] + xp) / pixel, height / 2 - (measured[1] + yp) / pixel])
    note("australis.txt", "", ideal, pixels)


def inpho():
    """Two cameras: upright with both principal points off the middle, and turned by 90 degrees; a third is of film."""
    (HERE / "inpho.prj").write_text("""$PROJECT 9.0.0
  $PROJECT_NAME : example
  $ANGULAR_UNITS : deg
$END
$PHOTO
  $PHOTO_NUM : 1001
  $CAMERA_ID : upright
  $EXT_ORI : 12:00:00 01/01/2026
      80.1    380000.0    5680000.0    1000.0
      1 0 0
      0 1 0
      0 0 1
$END
$CAMERA_DEFINITION
  $ID : upright
  $KIND : CCDFrame
  $BRAND : Custom
  $CCD_INTERIOR_ORIENTATION :
     192.3076923    -0.0012000    5770.2500000
       0.0000000  -192.3150000    4395.7500000
  $CCD_COLUMNS : 11540
  $CCD_ROWS : 8790
  $PIXEL_REFERENCE : CenterTopLeft
  $FOCAL_LENGTH :    80.1234500
  $PRINCIPAL_POINT_PPA :     0.021000     -0.034000
  $PRINCIPAL_POINT_PPS :     0.012000     0.007000
  $DISTORTION_TYPE :  Polynomial
  $RADIAL_COEFFS :
     -1.0e-4  -3.1e-6  8.5e-10  -6.0e-14
     0.0  0.0  0.0  0.0
  $DECENTRE_COEFFS :
     2.4e-6  -1.7e-6  0.0  0.0
$END
$CAMERA_DEFINITION
  $ID : turned
  $KIND : CCDFrame
  $CCD_COLUMNS : 8708
  $CCD_ROWS : 11608
  $PIXEL_REFERENCE : CenterTopLeft
  $ACTIVE_CALIBRATION : 2
  $CALIBRATION_SET :
    $ID : 1
    $FOCAL_LENGTH : 1.0
    $END
  $CALIBRATION_SET :
    $ID : 2
    $CCD_INTERIOR_ORIENTATION :
      0.0     -217.39  4358.5
      -217.39  0.0     5798.0
    $FOCAL_LENGTH : 51.68
    $PRINCIPAL_POINT_PPA : 0 0
    $PRINCIPAL_POINT_PPS : 0 0
    $DISTORTION_TYPE : Polynomial
    $RADIAL_COEFFS : 0 -1.4e-5 4.0e-9
    $DECENTRE_COEFFS : -3.4e-6 -4.3e-6
    $END
  $END
$END
$CAMERA_DEFINITION
  $ID : RMK
  $KIND : FilmFrame
  $FOCAL_LENGTH : 152.9
  $FIDUCIALS :
    1 -113 0
    2 113 0
$END
""")
    cameras = {
        "upright": ([[192.3076923, -0.0012], [0, -192.315]], (5770.25, 4395.75), 80.12345, (0.021, -0.034), (0.012, 0.007),
                    [-1e-4, -3.1e-6, 8.5e-10, -6e-14], (2.4e-6, -1.7e-6), np.eye(2), (11540, 8790)),
        # its x runs up in the image, and its y to the left
        "turned": ([[0, -217.39], [-217.39, 0]], (4358.5, 5798.0), 51.68, (0, 0), (0, 0),
                   [0, -1.4e-5, 4e-9], (-3.4e-6, -4.3e-6), np.array([[0, 1], [-1, 0]]), (8708, 11608)),
    }
    for name, (affine, origin, c, ppa, pps, k, (p1, p2), plate_from_image, size) in cameras.items():

        def corrected(place):
            x, y = place - pps
            r2 = x * x + y * y
            radial = sum(value * r2**power for power, value in enumerate(k))
            return place - [x * radial + p1 * (r2 + 2 * x * x) + 2 * p2 * x * y, y * radial + p2 * (r2 + 2 * y * y) + 2 * p1 * x * y]

        ideal = rays(*size, c * abs(np.linalg.det(affine)) ** 0.5)
        pixels = []
        for ray in ideal:
            wanted = plate_from_image @ (c * ray * [1, -1]) + ppa
            measured = wanted.copy()
            for _ in range(200):
                measured = measured + (wanted - corrected(measured))
            assert np.abs(wanted - corrected(measured)).max() < 1e-12
            # pixels count from the centre of the first one
            pixels.append(np.array(affine) @ measured + origin + 0.5)
        note("inpho.prj", name, ideal, pixels)


for make in (opencv, colmap, opensfm, metashape, pix4d, australis, inpho):
    make()
(HERE / "expected.csv").write_text("\n".join(["file,camera,ideal_x,ideal_y,x_px,y_px", *ROWS]) + "\n")
print(cv2.__version__, pycolmap.__version__, len(ROWS))
