"""Ortho-photos of a simulated photograph with terrain, by orthority from the exported orientation and by GDAL from the
exported RPC, against one that is computed here from the simulator's truth, by other formulas: both must lie within half a
pixel of it. `ortho.py GABLE RESULT.json SCENE EXPORTED`"""

import json
import pathlib
import shutil
import subprocess
import sys
import tempfile
import warnings

import numpy as np
import pyproj
import rasterio
import rasterio.warp


from readers import brown

warnings.filterwarnings("ignore")
GRID = "EPSG:25832"
WITHIN_PX = 0.5


def local_from_grid(frame, east, north, height):
    """Local east, north, up of grid coordinates with ellipsoidal heights."""
    longitude, latitude = pyproj.Transformer.from_crs(GRID, "EPSG:4979", always_xy=True).transform(east, north)
    to_local = pyproj.Transformer.from_pipeline(f"+proj=pipeline +step +proj=cart +ellps=WGS84 +step {frame}")
    return to_local.transform(longitude, latitude, height, radians=False)


def grid_from_local(frame, x, y, z):
    to_local = pyproj.Transformer.from_pipeline(f"+proj=pipeline +step +proj=cart +ellps=WGS84 +step {frame}")
    longitude, latitude, height = to_local.transform(x, y, z, direction="INVERSE")
    east, north = pyproj.Transformer.from_crs("EPSG:4979", GRID, always_xy=True).transform(longitude, latitude)
    return east, north, height


class Terrain:
    """The simulator's grid of the ground, in its local frame."""

    def __init__(self, path):
        lines = path.read_text().splitlines()
        head = dict(line.split() for line in lines[:6])
        self.west, self.south, self.cell = (float(head[name]) for name in ("xllcorner", "yllcorner", "cellsize"))
        self.heights = np.array([line.split() for line in lines[6:]], float)[::-1]

    def height(self, x, y):
        column, row = (x - self.west) / self.cell - 0.5, (y - self.south) / self.cell - 0.5
        return bilinear(self.heights, column, row)


def bilinear(array, column, row):
    c = np.clip(np.floor(column).astype(int), 0, array.shape[1] - 2)
    r = np.clip(np.floor(row).astype(int), 0, array.shape[0] - 2)
    fc, fr = np.clip(column - c, 0, 1), np.clip(row - r, 0, 1)
    return ((array[r, c] * (1 - fc) + array[r, c + 1] * fc) * (1 - fr)
            + (array[r + 1, c] * (1 - fc) + array[r + 1, c + 1] * fc) * fr)


def ground_height(frame, terrain, east, north, start):
    """The ellipsoidal height of the ground at grid coordinates."""
    height = np.full(np.shape(east), start, float)
    for _ in range(4):
        x, y, z = local_from_grid(frame, east, north, height)
        height = height + terrain.height(x, y) - z
    return height


def write_dem(path, frame, terrain, bounds, start, cell=1.0):
    west, south, east, north = bounds
    columns, rows = int((east - west) / cell), int((north - south) / cell)
    at_e, at_n = np.meshgrid(west + (np.arange(columns) + 0.5) * cell, north - (np.arange(rows) + 0.5) * cell)
    heights = ground_height(frame, terrain, at_e, at_n, start).astype("float32")
    with rasterio.open(path, "w", driver="GTiff", width=columns, height=rows, count=1, dtype="float32", crs=GRID,
                       transform=rasterio.transform.from_origin(west, north, cell, cell)) as dem:
        dem.write(heights, 1)


def true_ortho(truth, camera, photo, terrain, template, path):
    """Each pixel's ground point, projected by the true orientation."""
    frame = truth["frame"]
    columns, rows = np.meshgrid(np.arange(template.width) + 0.5, np.arange(template.height) + 0.5)
    east, north = template.transform * (columns, rows)
    start = truth["ground_height_m"]
    height = ground_height(frame, terrain, east, north, start)
    ground = np.stack(local_from_grid(frame, east, north, height), axis=-1)
    u = (ground - np.array(truth["projection_centre"])) @ np.array(truth["rotation_matrix"]).T
    distortion = {name: camera.get("distortion", {}).get(name, 0.0) for name in ("k1", "k2", "k3", "p1", "p2")}
    x, y = brown(-u[..., 0] / u[..., 2], u[..., 1] / u[..., 2], distortion)
    c, (u0, v0) = camera["principal_distance_px"], camera["principal_point_px"]
    column, row = u0 + c * x - 0.5, v0 + c * y - 0.5
    inside = (column >= 0) & (row >= 0) & (column < photo.shape[1] - 1) & (row < photo.shape[0] - 1)
    grey = np.where(inside, np.clip(bilinear(photo, column, row), 1, 255), 0)
    write_grey(path, grey, template)


def write_grey(path, grey, template):
    with rasterio.open(path, "w", driver="GTiff", width=template.width, height=template.height, count=1, dtype="uint8",
                       crs=template.crs, transform=template.transform) as file:
        file.write(np.round(grey).astype("uint8"), 1)


def rpc_ortho(photo_path, rpc_path, dem, template, path, work):
    image = work / "with_rpc.tif"
    with rasterio.open(photo_path) as photo:
        pixels = photo.read(1)
    with rasterio.open(image, "w", driver="GTiff", width=pixels.shape[1], height=pixels.shape[0], count=1, dtype="uint8") as file:
        file.write(pixels, 1)
    shutil.copy(rpc_path, work / "with_rpc_RPC.TXT")
    with rasterio.open(image) as source:
        grey, _ = rasterio.warp.reproject(
            source.read(1), np.zeros((template.height, template.width), "uint8"), rpcs=source.rpcs, src_crs="EPSG:4326",
            dst_transform=template.transform, dst_crs=template.crs, resampling=rasterio.warp.Resampling.bilinear, RPC_DEM=str(dem))
    write_grey(path, grey, template)


def main():
    gable, result, scene, exported = sys.argv[1], *map(pathlib.Path, sys.argv[2:5])
    truth = json.loads((scene / "truth.json").read_text())
    camera = json.loads((scene / "camera.json").read_text())
    terrain, photo_path = Terrain(scene / "terrain.asc"), scene / "photograph.png"
    photo = rasterio.open(photo_path).read(1).astype(float)
    failed = False
    with tempfile.TemporaryDirectory() as folder:
        work = pathlib.Path(folder)
        x, y, _ = truth["projection_centre"]
        reach = 1.4 * (truth["projection_centre"][2] - truth["ground_height_m"])
        east, north, _ = grid_from_local(truth["frame"], x, y, truth["ground_height_m"])
        write_dem(work / "dem.tif", truth["frame"], terrain, (east - reach, north - reach, east + reach, north + reach), truth["ground_height_m"])
        subprocess.run([gable, "ortho", "make", photo_path, "--result", result, "--camera", scene / "camera.json", "--dem", work / "dem.tif",
                        "--crs", GRID, "--out", work / "ortho", "--oty", pathlib.Path(sys.executable).with_name("oty"),
                        "--resolution-m", f"{truth['gsd_m']:.3f}"], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        by_orthority = work / "ortho/photograph_ORTHO.tif"
        with rasterio.open(by_orthority) as template:
            write_grey(work / "orthority.tif", template.read(1), template)
            true_ortho(truth, camera, photo, terrain, template, work / "truth.tif")
            rpc_ortho(photo_path, exported / "rpc/photograph_RPC.TXT", work / "dem.tif", template, work / "rpc.tif", work)
        for name in ("orthority", "rpc"):
            told = json.loads(subprocess.run([gable, "ortho", "check", work / f"{name}.tif", "--against", work / "truth.tif", "--json"],
                                             check=True, capture_output=True, text=True).stdout)
            common, p95 = np.linalg.norm(told["common_m"]) / told["gsd_m"], told["p95_m"] / told["gsd_m"]
            held = common <= WITHIN_PX and p95 <= WITHIN_PX and told["found"] > told["tried"] / 3
            failed |= not held
            print(f"{name:10} {told['found']} of {told['tried']} places: common shift {common:.3f} px, 95 % within {p95:.3f} px "
                  f"of {told['gsd_m']:.3f} m{'' if held else '   BROKEN'}")
    sys.exit(failed)


if __name__ == "__main__":
    main()
