"""Geoid grids that are made up: named, placed and encoded as the real ones, with numbers of the same size."""
import pathlib
import shutil
import struct

import numpy as np
import rasterio
from rasterio.transform import Affine

# name: west, south, east, north (of the outermost nodes), steps in degrees, about what, encoding
GRIDS = {
    "de_bkg_gcg2016.tif": (5.0, 47.0, 15.3, 56.0, 1 / 40, 1 / 60, 45, "float tiles"),
    "de_bkg_gcg2011.gtx": (5.0, 47.0, 15.3, 56.0, 1 / 40, 1 / 60, 45, "gtx"),
    "us_nga_egm96_15.tif": (-180.0, -90.0, 179.75, 90.0, 0.25, 0.25, 0, "float strips"),
    "us_nga_egm08_25.tif": (-180.0, -90.0, 180 - 1 / 8, 90.0, 1 / 8, 1 / 8, 0, "float tiles"),
    "us_noaa_g2018u0.tif": (-130.0, 24.0, -60.0, 58.0, 1 / 12, 1 / 12, -25, "float lzw"),
    "sk_gku_Slovakia_ETRS89h_to_EVRF2007.tif": (16.8, 47.6, 22.6, 49.7, 1 / 30, 1 / 50, 42, "float tiles"),
    "pl_gugik_geoid2021-PL-EVRF2007-NH.tif": (14.0, 49.0, 24.2, 55.0, 0.01, 0.01, 33, "float area"),
    "pl_gugik_geoid2011-PL-KRON86-NH.tif": (14.0, 49.0, 24.2, 55.0, 0.01, 0.01, 33, "float strips"),
    "jp_gsi_gsigeo2011.tif": (120.0, 20.0, 150.0, 50.0, 1 / 40, 1 / 60, 35, "int16"),
    "nl_nsgi_nlgeo2018.tif": (2.0, 50.0, 8.0, 56.0, 1 / 80, 1 / 120, 43, "float holes"),
    "be_ign_hBG18.tif": (2.4, 49.4, 6.5, 51.6, 1 / 36, 1 / 60, 44, "double"),
    "fr_ign_RAF20.tif": (-5.5, 42.0, 8.5, 51.5, 1 / 30, 1 / 40, 48, "float tiles"),
    "ch_swisstopo_chgeo2004_ETRS89_LN02.tif": (5.7, 45.6, 10.8, 48.0, 1 / 60, 1 / 80, 49, "float strips"),
    "uk_os_OSGM15_GB.tif": (-9.0, 49.0, 3.0, 61.5, 1 / 50, 1 / 75, 50, "float tiles"),
    "no_kv_HREF2018B_NN2000_EUREF89.tif": (3.0, 57.0, 33.0, 72.5, 1 / 20, 1 / 50, 40, "float holes"),
    "se_lantmateriet_SWEN17_RH2000.tif": (10.0, 54.5, 25.0, 69.5, 1 / 25, 1 / 50, 30, "int16"),
    "cz_cuzk_CR-2005.tif": (11.8, 48.3, 19.0, 51.3, 1 / 60, 1 / 60, 44, "float lzw"),
}


def make(folder: pathlib.Path, real: pathlib.Path | None) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for seed, (name, spec) in enumerate(GRIDS.items()):
        if real and (real / name).exists():
            shutil.copy(real / name, folder / name)
        elif not (folder / name).exists():
            write(folder / name, np.random.default_rng(seed), *spec)


def write(file, random, west, south, east, north, step_x, step_y, mean, encoding):
    columns, rows = round((east - west) / step_x) + 1, round((north - south) / step_y) + 1
    x, y = np.meshgrid(np.linspace(0, 9, columns), np.linspace(0, 9, rows))
    heights = mean + 8 * np.sin(x) * np.cos(y / 2) + random.normal(0, 0.3, (rows, columns))
    if encoding == "gtx":
        head = struct.pack(">4d2i", south, west, step_y, step_x, rows, columns)
        file.write_bytes(head + heights.astype(">f4").tobytes())
        return
    heights = heights[::-1]
    if encoding == "float holes":
        heights[random.random(heights.shape) < 0.002] = -9999
    kind = {"int16": "int16", "double": "float64"}.get(encoding, "float32")
    layout = {"compress": "deflate"}
    if encoding in ("float tiles", "float holes", "float area"):
        layout |= {"tiled": True, "blockxsize": 256, "blockysize": 256, "predictor": 3}
    if encoding == "float lzw":
        layout |= {"compress": "lzw", "predictor": 1, "blockysize": 7}
    if encoding == "int16":
        heights = np.round((heights - mean) / 0.001)
        layout |= {"predictor": 2}
    if encoding == "float holes":
        layout |= {"nodata": -9999}
    # rasterio counts from the corner of the pixel whose centre is the node
    transform = Affine(step_x, 0, west - step_x / 2, 0, -step_y, south + (rows - 1) * step_y + step_y / 2)
    with rasterio.open(
        file, "w", driver="GTiff", width=columns, height=rows, count=1, dtype=kind, crs="EPSG:4979", transform=transform,
        **layout,
    ) as grid:
        point = "Area" if encoding == "float area" else "Point"
        grid.update_tags(AREA_OR_POINT=point, TYPE="VERTICAL_OFFSET_GEOGRAPHIC_TO_VERTICAL")
        grid.set_band_description(1, "geoid_undulation")
        grid.units = ("metre",)
        if encoding == "int16":
            grid.scales, grid.offsets = (0.001,), (mean,)
        grid.write(heights.astype(kind), 1)
