"""Reads what `gable export` wrote by the software that it is for, or by a parser written from the format's description,
and projects the five check points of the manifest: their pixels must come out within 0.05 px, or within what the manifest
states that the format loses (RPC; Inpho and ArcGIS where a lens bends more than their polynomials do).

Of formats in a map grid the ground is in that grid's coordinates, of the others in the local frame; the orientation in
the grid is a fit, whose stated residual is allowed on top."""

import argparse
import csv
import json
import math
import pathlib
import re
import shutil
import sys
import tempfile
import warnings
import xml.etree.ElementTree as ElementTree

import numpy as np

warnings.filterwarnings("ignore")
WITHIN_PX = 0.05


def opk(omega, phi, kappa):
    """Rotation of the camera (x right, y up, z backwards) to object space, radians."""
    co, so, cp, sp, ck, sk = (f(a) for a in (omega, phi, kappa) for f in (math.cos, math.sin))
    rx = np.array([[1, 0, 0], [0, co, -so], [0, so, co]])
    ry = np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]])
    rz = np.array([[ck, -sk, 0], [sk, ck, 0], [0, 0, 1]])
    return rx, ry, rz


def brown(x, y, d):
    """Ideal coordinates, y down, as OpenCV bends them."""
    r2 = x * x + y * y
    radial = 1 + r2 * (d["k1"] + r2 * (d["k2"] + r2 * d["k3"]))
    return (x * radial + 2 * d["p1"] * x * y + d["p2"] * (r2 + 2 * x * x),
            y * radial + d["p1"] * (r2 + 2 * y * y) + 2 * d["p2"] * x * y)


def by_contract(camera, object_from_camera, centre, point):
    """The pixel by the camera of the manifest: for formats that hold the exterior orientation alone."""
    u = object_from_camera.T @ (np.array(point) - centre)
    x, y = brown(-u[0] / u[2], u[1] / u[2], camera["distortion"])
    d, (u0, v0), c = camera["distortion"], camera["principal_point_px"], camera["principal_distance_px"]
    return np.array([u0 + c * x + d["b1_px"] * x + d["b2_px"] * y, v0 + c * y])


def uncorrected(target_x, target_y, k, p):
    """Measured coordinates of which the photogrammetric corrections make the wanted ones, by fixed-point iteration."""
    x, y = target_x, target_y
    for _ in range(200):
        r2 = x * x + y * y
        radial = k[0] + r2 * (k[1] + r2 * (k[2] + r2 * k[3]))
        x, y = (target_x - (x * radial + p[0] * (r2 + 2 * x * x) + 2 * p[1] * x * y),
                target_y - (y * radial + p[1] * (r2 + 2 * y * y) + 2 * p[0] * x * y))
    return x, y


class Export:
    """A folder with a folder for each format."""

    def __init__(self, path):
        self.path = pathlib.Path(path)
        self.manifest = json.loads((self.path / "manifest/manifest.json").read_text())

    def text(self, *names):
        return self.path.joinpath(*names).read_text()

    def file(self, *names):
        return self.path.joinpath(*names)


def words(text):
    return [line.split() for line in text.splitlines() if line.strip()]


def opk_csv(export):
    """orthority (its reader of CSV, with its own camera file)."""
    import orthority
    cameras = orthority.FrameCameras(str(export.file("orthority/interior.yaml")), str(export.file("opk_csv/orientations.csv")))
    return lambda photo, point: cameras.get(photo["name"]).world_to_pixel(np.array(point["grid_m"]).reshape(3, 1)).ravel() + 0.5


def orthority_files(export):
    """orthority"""
    import orthority
    cameras = orthority.FrameCameras(str(export.file("orthority/interior.yaml")), str(export.file("orthority/exterior.geojson")))
    return lambda photo, point: cameras.get(photo["name"]).world_to_pixel(np.array(point["grid_m"]).reshape(3, 1)).ravel() + 0.5


def colmap(export):
    """pycolmap"""
    import pycolmap
    model = pycolmap.Reconstruction(str(export.file("colmap")))
    images = {image.name: image for image in model.images.values()}

    def pixel(photo, point):
        image = images[photo["name"].replace(" ", "_")]
        pose = image.cam_from_world() if callable(image.cam_from_world) else image.cam_from_world
        return image.camera.img_from_cam(np.asarray(pose * np.array(point["local_m"])).reshape(1, 3)).ravel()
    return pixel


def rpc(export):
    """GDAL (its RPC transformer, by _RPC.TXT)"""
    return gdal(export, "_RPC.TXT")


def rpc_metadata(export):
    """GDAL (its RPC transformer, by .aux.xml)"""
    return gdal(export, ".aux.xml")


def gdal(export, ending):
    import rasterio
    from rasterio.transform import RPCTransformer
    transformers = {}
    with tempfile.TemporaryDirectory() as folder:
        for photo in export.manifest["photographs"]:
            name = re.sub(r"[^\w.-]", "_", photo["name"])
            image = pathlib.Path(folder, name).with_suffix(".tif")
            with rasterio.open(image, "w", driver="GTiff", width=4, height=4, count=1, dtype="uint8"):
                pass
            source = f"{pathlib.Path(name).stem}_RPC.TXT" if ending == "_RPC.TXT" else f"{name}.aux.xml"
            shutil.copy(export.file("rpc", source), image.with_name(f"{image.stem}_RPC.TXT" if ending == "_RPC.TXT" else f"{image.name}.aux.xml"))
            with rasterio.open(image) as opened:
                assert opened.rpcs is not None, "GDAL finds no RPC"
                transformers[photo["name"]] = RPCTransformer(opened.rpcs)

    def pixel(photo, point):
        longitude, latitude, height = point["longitude_latitude_height"]
        rows, columns = transformers[photo["name"]].rowcol([longitude], [latitude], zs=[height], op=lambda value: value)
        return np.array([columns[0], rows[0]])
    return pixel


def opensfm(export):
    """a parser of OpenSfM's documentation: angle-axis, brown camera in units of the larger side"""
    reconstruction = json.loads(export.text("opensfm/reconstruction.json"))[0]

    def pixel(photo, point):
        shot = reconstruction["shots"][photo["name"]]
        camera = reconstruction["cameras"][shot["camera"]]
        axis = np.array(shot["rotation"])
        angle = np.linalg.norm(axis)
        a = axis / angle
        cross = np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])
        rotation = np.eye(3) + math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross
        u = rotation @ np.array(point["local_m"]) + np.array(shot["translation"])
        x, y = brown(u[0] / u[2], u[1] / u[2], camera)
        width, height = camera["width"], camera["height"]
        side = max(width, height)
        # normalized to denormalized image coordinates, in which integers are centres of pixels
        return np.array([(camera["focal_x"] * x + camera["c_x"]) * side + (width - 1) / 2 + 0.5,
                         (camera["focal_y"] * y + camera["c_y"]) * side + (height - 1) / 2 + 0.5])
    return pixel


def patb(export):
    """a parser: name c X Y Z, then rows of the rotation from the camera to the ground"""
    lines = words(export.text("patb/orientations.ori"))
    found = {}
    for n in range(0, len(lines), 4):
        name, c, *centre = lines[n]
        found[name] = (float(c), np.array(centre, float), np.array(lines[n + 1:n + 4], float))

    def pixel(photo, point):
        c, centre, rotation = found[photo["name"].replace(" ", "_")]
        camera = photo["camera"]
        assert abs(c - camera["principal_distance_px"] * camera["pixel_size_mm"]) < 1e-5
        return by_contract(camera, rotation, centre, point["grid_m"])
    return pixel


def by_angles(lines, angles):
    """name X Y Z and three angles, of which `angles` makes the rotation from the camera to the ground."""
    found = {name: (np.array([float(v) for v in values[:3]]), angles(*(float(v) for v in values[3:6]))) for name, *values in lines}

    def pixel(photo, point):
        centre, rotation = found[photo["name"].replace(" ", "_")]
        return by_contract(photo["camera"], rotation, centre, point["grid_m"])
    return pixel


def degrees(omega, phi, kappa):
    rx, ry, rz = opk(*(math.radians(a) for a in (omega, phi, kappa)))
    return rx @ ry @ rz


def bingo(export):
    """a parser: ORIA name X Y Z phi omega kappa in gon, R = Ry(phi) Rx(omega) Rz(kappa)"""
    def rotation(phi, omega, kappa):
        rx, ry, rz = opk(*(math.radians(0.9 * a) for a in (omega, phi, kappa)))
        return ry @ rx @ rz
    return by_angles([line[1:] for line in words(export.text("bingo/orientations.bingo"))], rotation)


def applanix(export):
    """a parser: ID TIME E N H omega phi kappa LAT LONG in degrees"""
    lines = [line for line in words(export.text("applanix/orientations_eo.txt")) if not line[0].startswith("#")]
    return by_angles([[line[0], *line[2:]] for line in lines], degrees)


def odm(export):
    """a parser: the CRS, then name x y z; only a position, so the pixel is that of the manifest's rotation"""
    crs, *lines = words(export.text("odm/geo.txt"))
    assert " ".join(crs) == export.manifest["grid_crs"]
    found = {name: np.array(values, float) for name, *values in lines}

    def pixel(photo, point):
        import pyproj
        longitude, latitude, height = point["longitude_latitude_height"]
        centre = found[photo["name"].replace(" ", "_")]
        to_grid = pyproj.Transformer.from_crs("EPSG:4979", export.manifest["grid_crs"], always_xy=True)
        back = to_grid.transform(*centre[:2], direction="INVERSE")
        local = pyproj.Transformer.from_pipeline(f"+proj=pipeline +step +proj=cart +ellps=WGS84 +step {export.manifest['local_frame']}")
        position = np.array(local.transform(back[0], back[1], centre[2]))
        return by_contract(photo["camera"], np.array(photo["local"]["rotation_matrix"]).T, position, point["local_m"])
    return pixel


def pix4d(export):
    """a parser of Pix4D's description: imageName X Y Z Omega Phi Kappa, camera in mm from the sensor's corner"""
    lines = words(export.text("pix4d/calibrated_external_camera_parameters.txt"))[1:]
    found = {name: (np.array(values[:3], float), degrees(*map(float, values[3:]))) for name, *values in lines}
    cameras, current, sensor = {}, None, None
    for line in export.text("pix4d/calibrated_internal_camera_parameters.cam").splitlines():
        if line.startswith("#Camera:"):
            current = cameras.setdefault(line.split()[1], {})
        elif line.startswith("#Focal Length mm"):
            current["sensor"] = [float(v) for v in re.search(r"of ([\d.]+)x([\d.]+)mm", line).groups()]
        elif line and not line.startswith(("#", "Pix4D")):
            name, value = line.split()
            current[name] = float(value)

    def pixel(photo, point):
        centre, rotation = found[photo["name"].replace(" ", "_")]
        camera = cameras[photo["camera"]["name"].replace(" ", "_")]
        u = rotation.T @ (np.array(point["grid_m"]) - centre)
        x, y = brown(-u[0] / u[2], u[1] / u[2],
                     {"k1": camera["K1"], "k2": camera["K2"], "k3": camera["K3"], "p1": camera["T1"], "p2": camera["T2"]})
        mm = camera["sensor"][0] / photo["camera"]["image_size_px"][0]
        return np.array([camera["Px"] + camera["F"] * x, camera["Py"] + camera["F"] * y]) / mm
    return pixel


def inpho(export):
    """a parser: $PHOTO with $EXT_ORI c X Y Z and rows of the rotation, $CAMERA_DEFINITION in mm, centre of pixels"""
    text = export.text("inpho/gable.prj")

    def section(name):
        return re.findall(rf"\${name}\n(.*?)\$END_{name}", text, re.S)

    def field(body, name):
        return re.search(rf"\${name} :\s*(.*)", body).group(1).split()

    cameras, photos = {}, {}
    for body in section("CAMERA_DEFINITION"):
        affine = np.array(re.search(r"\$CCD_INTERIOR_ORIENTATION :\s*\n(.*)\n(.*)\n", body).group(0).split()[2:], float).reshape(2, 3)
        cameras[field(body, "ID")[0]] = (float(field(body, "PRINCIPAL_DISTANCE")[0]), affine,
                                         [-float(v) for v in field(body, "RADIAL_COEFFS")], [-float(v) for v in field(body, "DECENTRE_COEFFS")])
    for body in section("PHOTO"):
        numbers = np.array(body.split("$EXT_ORI : 0\n")[1].split(), float)
        photos[field(body, "PHOTO_FILE")[0]] = (field(body, "CAMERA_ID")[0], numbers[1:4], numbers[4:13].reshape(3, 3))

    def pixel(photo, point):
        camera, centre, rotation = photos[photo["name"].replace(" ", "_")]
        c, affine, k, p = cameras[camera]
        u = rotation.T @ (np.array(point["grid_m"]) - centre)
        x, y = uncorrected(-c * u[0] / u[2], -c * u[1] / u[2], k, p)
        return affine @ np.array([x, y, 1]) + 0.5
    return pixel


def esri(export):
    """a parser of ArcGIS' schema: frames and cameras tables, microns, affine from pixels to the sensor"""
    frames = {row["Raster"]: row for row in csv.DictReader(export.text("esri/frames.csv").splitlines())}
    cameras = {row["CameraID"]: row for row in csv.DictReader(export.text("esri/cameras.csv").splitlines())}

    def pixel(photo, point):
        frame = frames[photo["name"]]
        camera = cameras[frame["CameraID"]]
        centre = np.array([float(frame[f"Perspective{axis}"]) for axis in "XYZ"])
        rotation = degrees(*(float(frame[name]) for name in ("Omega", "Phi", "Kappa")))
        u = rotation.T @ (np.array(point["grid_m"]) - centre)
        c = float(camera["FocalLength"])
        k, p = ([float(v) for v in camera[name].split(";")] for name in ("Radial", "Tangential"))
        x, y = uncorrected(-c * u[0] / u[2], -c * u[1] / u[2], k, p)
        a = {name: float(camera[name]) for name in ("A0", "A1", "A2", "B0", "B1", "B2")}
        assert camera["AffineDirection"] == "1"
        film_from_pixel = np.array([[a["A1"], a["A2"]], [a["B1"], a["B2"]]])
        return np.linalg.solve(film_from_pixel, np.array([x - a["A0"], y - a["B0"]])) + 0.5
    return pixel


def micmac(export):
    """a parser of MicMac's XML: Centre, CodageMatr (camera to world, y down, z forward), ModPhgrStd from ideal to image"""
    def numbers(tree, name):
        return np.array(tree.find(f".//{name}").text.split(), float)

    def pixel(photo, point):
        name = re.sub(r"[^\w.-]", "_", photo["name"])
        orientation = ElementTree.parse(export.file(f"micmac/Ori-Gable/Orientation-{name}.xml"))
        calibration = ElementTree.parse(export.file("micmac", orientation.find(".//FileInterne").text))
        rotation = np.array([numbers(orientation, f"L{row}") for row in (1, 2, 3)])
        u = rotation.T @ (np.array(point["local_m"]) - numbers(orientation, "Centre"))
        principal, (focal,) = numbers(calibration, "PP"), numbers(calibration, "F")
        x, y = focal * u[:2] / u[2] + principal - numbers(calibration, "CDist")
        k = [float(node.text) for node in calibration.iterfind(".//CoeffDist")]
        p1, p2, b1, b2 = (numbers(calibration, name)[0] for name in ("P1", "P2", "b1", "b2"))
        r2 = x * x + y * y
        radial = sum(value * r2 ** (power + 1) for power, value in enumerate(k))
        return numbers(calibration, "CDist") + np.array([
            x + x * radial + p1 * (2 * x * x + r2) + 2 * p2 * x * y + b1 * x + b2 * y,
            y + y * radial + p2 * (2 * y * y + r2) + 2 * p1 * x * y])
    return pixel


def footprints(export):
    """rasterio (its reader of GeoJSON geometries): the check point at mean height must lie inside, pixels are the manifest's"""
    from rasterio.features import geometry_mask
    from rasterio.transform import from_bounds
    features = {f["properties"]["filename"]: f["geometry"] for f in json.loads(export.text("footprints/footprints.geojson"))["features"]}

    def pixel(photo, point):
        longitude, latitude, _ = point["longitude_latitude_height"]
        at = from_bounds(longitude - 1e-7, latitude - 1e-7, longitude + 1e-7, latitude + 1e-7, 1, 1)
        inside = geometry_mask([features[photo["name"]]], (1, 1), at, invert=True)[0, 0]
        return np.array(point["pixel_px"]) if inside else np.array([math.inf, math.inf])
    return pixel


IN_GRID = [opk_csv, orthority_files, patb, bingo, applanix, pix4d, inpho, esri]
LOCAL = [colmap, opensfm, micmac, odm, footprints]
RATIONAL = [rpc, rpc_metadata]


def stated_px(reader, photo):
    """What the manifest says that is lost on the way into the format."""
    if reader in RATIONAL:
        return photo["rpc"]["residual_max_px"]
    if reader in (inpho, esri):
        return photo["camera"]["photogrammetric_corrections"]["residual_max_px"]
    return 0.0


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", help="what `gable export --format all --out FOLDER` wrote")
    export = Export(parser.parse_args().folder)
    failed = False
    print(f"{'format':16} {'worst px':>9} {'allowed':>8}  read by")
    for reader in IN_GRID + LOCAL + RATIONAL:
        pixel, worst, allowed = reader(export), 0.0, 0.0
        for photo in export.manifest["photographs"]:
            for point in photo["check_points"]:
                # what the grid's fit leaves is stated, and is that of the numbers, not of the format
                expected = point["by_grid_px"] if reader in IN_GRID else point["pixel_px"]
                off = float(np.linalg.norm(pixel(photo, point) - np.array(expected)))
                worst = max(worst, off)
            bound = stated_px(reader, photo)
            allowed = max(allowed, bound, WITHIN_PX)
        held = worst <= allowed
        failed |= not held
        print(f"{reader.__name__:16} {worst:9.4f} {allowed:8.3f}  {reader.__doc__ or ''}{'' if held else '   BROKEN'}")
    for photo in export.manifest["photographs"]:
        fit = photo["grid"]
        print(f"{photo['name']}: fit to {export.manifest['grid_crs']}: rms {fit['residual_rms_px']:.3f} px, worst "
              f"{fit['residual_max_px']:.3f} px, {fit['residual_max_m']:.3f} m; RPC rms {photo['rpc']['residual_rms_px']:.4f} px, "
              f"worst {photo['rpc']['residual_max_px']:.4f} px")
    sys.exit(failed)


if __name__ == "__main__":
    main()
