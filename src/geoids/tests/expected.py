#!/usr/bin/env python3
"""Makes the small grids of this folder, and what PROJ makes of them (expected.csv).

    python3 -m venv venv && venv/bin/pip install pyproj==3.7.2 rasterio numpy && venv/bin/python expected.py

The grids have the names of real ones, so that PROJ finds them by EPSG code, and numbers that were made up.
"""
import pathlib
import struct
import warnings

import numpy as np
import pyproj
import rasterio
from rasterio.transform import Affine

warnings.filterwarnings("ignore")
HERE = pathlib.Path(__file__).parent
KIND = "VERTICAL_OFFSET_GEOGRAPHIC_TO_VERTICAL"


def surface(rows, columns, mean, seed):
    y, x = np.mgrid[0:rows, 0:columns]
    return mean + 3 * np.sin(x / 5) + 2 * np.cos(y / 4) + np.random.default_rng(seed).normal(0, 0.2, (rows, columns))


def tif(name, west, south, step_x, step_y, heights, point="Point", kind="float32", scale=1.0, offset=0.0, append=False, tags=None,
        **layout):
    rows, columns = heights.shape
    transform = Affine(step_x, 0, west - step_x / 2, 0, -step_y, south + (rows - 0.5) * step_y)
    if append:
        layout["APPEND_SUBDATASET"] = True
    with rasterio.open(HERE / name, "w", driver="GTiff", width=columns, height=rows, count=1, dtype=kind, crs="EPSG:4979",
                       transform=transform, **layout) as grid:
        grid.update_tags(AREA_OR_POINT=point, TYPE=KIND, **(tags or {}))
        grid.set_band_description(1, "geoid_undulation")
        grid.units = ("metre",)
        if scale != 1.0:
            grid.scales, grid.offsets = (scale,), (offset,)
        grid.write(((heights - offset) / scale).astype(kind), 1)


def main():
    tif("de_bkg_gcg2016.tif", 6.9, 50.4, 0.025, 1 / 60, surface(25, 29, 46, 1), tiled=True, blockxsize=16, blockysize=16,
        compress="deflate", predictor=3)
    tif("jp_gsi_gsigeo2011.tif", 139.5, 35.4, 0.025, 1 / 60, surface(25, 29, 36, 2), point="Area", kind="int16", scale=0.001, offset=35.0,
        compress="deflate", predictor=2, blockysize=7)
    holes = surface(25, 29, 43, 3)
    holes[3:5, 4:9] = -9999
    tif("nl_nsgi_nlgeo2018.tif", 5.0, 52.0, 0.0125, 1 / 120, holes, nodata=-9999, compress="lzw", blockysize=5)
    # the whole Earth, without the column at 180 degrees again
    tif("us_nga_egm96_15.tif", -180.0, -90.0, 10.0, 10.0, surface(19, 36, 0, 4), compress="deflate")
    # a fine grid within a coarse one
    tif("no_kv_HREF2018B_NN2000_EUREF89.tif", 9.0, 59.0, 0.25, 0.25, surface(9, 13, 40, 5), kind="float64",
        tags={"grid_name": "coarse"})
    tif("no_kv_HREF2018B_NN2000_EUREF89.tif", 10.0, 59.5, 0.05, 0.05, surface(11, 13, 40.5, 6), kind="float64", append=True,
        tags={"grid_name": "fine", "parent_grid_name": "coarse"})
    heights = surface(25, 29, 45, 7)
    (HERE / "de_bkg_gcg2011.gtx").write_bytes(struct.pack(">4d2i", 50.4, 6.9, 1 / 60, 0.025, *heights.shape) + heights.astype(">f4").tobytes())

    pyproj.datadir.append_data_dir(str(HERE))
    random, lines = np.random.default_rng(0), []
    areas = {
        "EPSG:25832+7837": (6.9, 50.4, 7.6, 50.8), "EPSG:9924": (6.9, 50.4, 7.6, 50.8), "EPSG:5555": (6.9, 50.4, 7.6, 50.8),
        "EPSG:31466+7837": (6.9, 50.4, 7.6, 50.8),
        "EPSG:6697": (139.5, 35.4, 140.2, 35.8), "EPSG:6677+6695": (139.5, 35.4, 140.2, 35.8), "EPSG:10170": (139.5, 35.4, 140.2, 35.8),
        "EPSG:25831+5709": (5.15, 52.06, 5.35, 52.2), "EPSG:4326+5773": (-180, -85, 180, 85), "EPSG:32660+5773": (177, 5, 180, 60),
        "EPSG:5972": (10.05, 59.55, 10.55, 59.95), "EPSG:25832+5941": (9.0, 59.0, 9.9, 61.0),
        "EPSG:7415": (5.15, 52.06, 5.35, 52.2), "EPSG:28992+5709": (5.15, 52.06, 5.35, 52.2),
    }
    for name, (west, south, east, north) in areas.items():
        for _ in range(4):
            place = random.uniform(west, east), random.uniform(south, north), random.uniform(-50, 2000)
            transformer = of(name)
            position = [float(f"{v:.9f}") for v in transformer.transform(*place, direction="INVERSE")]
            ellipsoid = "WGS84" if name in ("EPSG:4326+5773", "EPSG:32660+5773") else "GRS80"
            geocentric = geocentric_of(ellipsoid).transform(*transformer.transform(*position))
            lines.append(",".join([name, *map(repr, position), *map(repr, geocentric)]))
    (HERE / "expected.csv").write_text("\n".join(["crs,x,y,z,geocentric_x_m,geocentric_y_m,geocentric_z_m", *lines]) + "\n")
    print(pyproj.__version__, pyproj.proj_version_str)


def geocentric_of(ellipsoid):
    return pyproj.Transformer.from_pipeline(
        f"+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad +step +proj=cart +ellps={ellipsoid}")


DHDN = "+step +proj=push +v_3 +step +proj=cart +ellps=bessel +step +proj=helmert +x=598.1 +y=73.7 +z=418.2 +rx=0.202 " \
    "+ry=0.045 +rz=-2.455 +s=6.7 +convention=position_vector +step +inv +proj=cart +ellps=GRS80 +step +proj=pop +v_3"


def of(name):
    """To longitude, latitude and ellipsoidal height; PROJ has no grid for DHHN92, and its own mind about DHDN."""
    by_hand = {"EPSG:5555": ("+step +inv +proj=utm +zone=32 +ellps=GRS80", "de_bkg_gcg2011.gtx"),
               "EPSG:31466+7837": (f"+step +inv +proj=tmerc +lon_0=6 +x_0=2500000 +ellps=bessel {DHDN}", "de_bkg_gcg2016.tif")}
    if name in by_hand:
        steps, grid = by_hand[name]
        return pyproj.Transformer.from_pipeline(
            f"+proj=pipeline {steps} +step +inv +proj=vgridshift +grids={grid} +step +proj=unitconvert +xy_in=rad +xy_out=deg")
    best = pyproj.transformer.TransformerGroup(name, "EPSG:4979", always_xy=True).transformers[0]
    assert "vgridshift" in best.definition, best.definition
    return best


main()
