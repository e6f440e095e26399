"""Every system of `gable crs` against PROJ. Called by `run`."""
import os
import pathlib
import subprocess
import sys
import warnings

import numpy as np
import pyproj
from pyproj.aoi import AreaOfInterest

from grids import GRIDS, make

warnings.filterwarnings("ignore")
LIMIT_MM = 0.001
DHDN = "+step +proj=push +v_3 +step +proj=cart +ellps=bessel +step +proj=helmert +x=598.1 +y=73.7 +z=418.2 +rx=0.202 " \
    "+ry=0.045 +rz=-2.455 +s=6.7 +convention=position_vector +step +inv +proj=cart +ellps=GRS80 +step +proj=pop +v_3"
# Amersfoort to ETRS89 (8), EPSG:9281, in PROJ's own words: with the network it would prefer the correction grid
RD = "+step +proj=push +v_3 +step +proj=cart +ellps=bessel +step +proj=helmert +x=565.7381 +y=50.4018 +z=465.2904 " \
    "+rx=0.395025981036064 +ry=-0.330772431242031 +rz=1.87607329462821 +s=4.07244 +convention=coordinate_frame " \
    "+step +inv +proj=cart +ellps=GRS80 +step +proj=pop +v_3"

HORIZONTAL = [4326, 4979, 4258, 4937, 6668, 6667, 3857, *range(32601, 32661), *range(32701, 32761), *range(25828, 25839),
              *range(2176, 2181), *range(31466, 31470), 28992, *range(6669, 6688)]
# compound: by code of PROJ, so that its own choice of the operation is checked too
COMPOUND = ["EPSG:25832+7837", "EPSG:25833+7837", "EPSG:4258+7837", "EPSG:9924", "EPSG:4326+5773", "EPSG:9707", "EPSG:32633+5773",
            "EPSG:32755+5773", "EPSG:9518", "EPSG:32632+3855", "EPSG:3857+3855", "EPSG:32614+5703", "EPSG:4326+5703", "EPSG:7423", "EPSG:2180+9651",
            "EPSG:2178+9651", "EPSG:2180+9650", "EPSG:6697", "EPSG:6677+6695", *(f"EPSG:{code}" for code in range(10162, 10175)),
            "EPSG:25831+5709", "EPSG:7415", "EPSG:28992+5709", "EPSG:9286", "EPSG:25831+5710", "EPSG:25831+5720", "EPSG:25832+5728", "EPSG:25830+5701",
            *(f"EPSG:{code}" for code in range(5971, 5977)), "EPSG:25833+5613", "EPSG:25833+8357"]
# by pipeline: PROJ knows no grid for DHHN92, and prefers another grid to the transformation of DHDN
BY_PIPELINE = {"EPSG:5554": (25831, "de_bkg_gcg2011.gtx"), "EPSG:5555": (25832, "de_bkg_gcg2011.gtx"),
               "EPSG:5556": (25833, "de_bkg_gcg2011.gtx"), "EPSG:31467+7837": (31467, "de_bkg_gcg2016.tif"),
               "EPSG:31466+7837": (31466, "de_bkg_gcg2016.tif")}


def projection(code):
    """The steps from positions of a system to longitude, latitude in degrees and ellipsoidal height."""
    crs = pyproj.CRS.from_epsg(code)
    if crs.is_geographic:
        return ""
    back = f"+step +inv {crs.to_proj4().replace('+type=crs', '').replace('+nadgrids=@null', '').replace('+wktext', '')}"
    if code == 3857:
        back = "+step +inv +proj=webmerc +ellps=WGS84"
    datum = RD if code == 28992 else DHDN if 31466 <= code <= 31469 else ""
    return f"{back} {datum} +step +proj=unitconvert +xy_in=rad +xy_out=deg"


def transformer(name):
    if name in BY_PIPELINE:
        code, grid = BY_PIPELINE[name]
        degrees = "+step +proj=unitconvert +xy_in={} +xy_out={}"
        heights = f"{degrees.format('deg', 'rad')} +step +inv +proj=vgridshift +grids={grid} {degrees.format('rad', 'deg')}"
        return pyproj.Transformer.from_pipeline(f"+proj=pipeline {projection(code)} {heights}"), code
    number = name.removeprefix("EPSG:")
    if name in COMPOUND:
        crs = pyproj.CRS(name)
        group = pyproj.transformer.TransformerGroup(crs, "EPSG:4979", always_xy=True)
        best = group.transformers[0]
        if "vgridshift" not in best.definition:
            raise SystemExit(f"{name}: PROJ does not use a grid: {best.definition}")
        return best, int(crs.sub_crs_list[0].to_epsg())
    steps = projection(int(number))
    return pyproj.Transformer.from_pipeline(f"+proj=pipeline {steps}" if steps else "+proj=noop"), int(number)


def area(name, code):
    """Longitudes and latitudes in which points are drawn: those of the register, within the grid."""
    west, south, east, north = pyproj.CRS.from_epsg(code).area_of_use.bounds
    grid = BY_PIPELINE[name][1] if name in BY_PIPELINE else grid_of(name)
    if grid:
        w, s, e, n = GRIDS[grid][:4]
        west, south, east, north = max(west, w), max(south, s), min(east, e), min(north, n)
    return west, max(south, -84), east, min(north, 84)


def grid_of(name):
    if name not in COMPOUND:
        return None
    definition = transformer(name)[0].definition
    return definition.split("grids=")[1].split()[0]


def gable(source, target, positions, folder):
    command = [os.environ["GABLE"], "crs", "transform", "--from", source, "--to", target, "--decimals", "9", "--geoids", str(folder)]
    text = "".join(f"{x!r} {y!r} {z!r}\n" for x, y, z in positions.tolist())
    done = subprocess.run(command, input=text, capture_output=True, text=True)
    rows = [[np.nan] * 3 if line.startswith("*") else [float(word) for word in line.split()] for line in done.stdout.splitlines()]
    if len(rows) != len(positions):
        raise SystemExit(f"{source} -> {target}: {done.stderr[:500]}")
    return np.array(rows), done.stderr


def metres(code, difference, latitude):
    """Differences of geographic positions as metres."""
    if pyproj.CRS.from_epsg(code).is_geographic:
        return difference * np.stack([111_320 * np.cos(np.radians(latitude)), np.full_like(latitude, 111_320), np.ones_like(latitude)], 1)
    return difference


def main():
    work, points = pathlib.Path(sys.argv[1]), int(sys.argv[2])
    folder = work / "grids"
    real = os.environ.get("GABLE_SYSTEMS_GRIDS")
    make(folder, pathlib.Path(real) if real else None)
    pyproj.datadir.append_data_dir(str(folder))
    pyproj.network.set_network_enabled(False)
    random, broken, worst = np.random.default_rng(1), 0, {}
    for name in [*(f"EPSG:{code}" for code in HORIZONTAL), *COMPOUND, *BY_PIPELINE]:
        to_ellipsoid, code = transformer(name)
        west, south, east, north = area(name, code)
        place = np.stack([random.uniform(west, east, points), random.uniform(south, north, points), random.uniform(-100, 3000, points)], 1)
        position = np.stack(to_ellipsoid.transform(*place.T, direction="INVERSE"), 1)
        position = position[np.isfinite(position).all(axis=1)]
        truth = np.stack(to_ellipsoid.transform(*position.T), 1)
        # PROJ keeps longitude and latitude between ETRS89 and WGS 84, gable the geocentric place: 0.1 mm between their
        # ellipsoids, which is left out here
        geographic = "EPSG:4979" if pyproj.CRS.from_epsg(code).ellipsoid.name == "WGS 84" else "EPSG:4937"
        there, refused = gable(name, geographic, position, folder)
        back, _ = gable(geographic, name, truth, folder)
        known = np.isfinite(there).all(axis=1)
        outside = sum("do not reach" in line for line in refused.splitlines())
        off_there = metres(4979, there - truth, truth[:, 1])[known]
        off_back = metres(code, back - position, truth[:, 1])[np.isfinite(back).all(axis=1)]
        plane_mm = 1000 * max(np.abs(off[:, :2]).max() for off in (off_there, off_back))
        height_mm = 1000 * max(np.abs(off[:, 2]).max() for off in (off_there, off_back))
        # beside a node without a number PROJ makes do with the others, and gable refuses
        explained = outside == (~known).sum() and outside <= 0.03 * points
        good = explained and len(off_there) > 0.9 * points and max(plane_mm, height_mm) <= LIMIT_MM
        broken += not good
        worst[name] = max(plane_mm, height_mm)
        print(f"{name:18} {known.sum():5} points, {outside:3} refused  plane {plane_mm:.6f} mm  height {height_mm:.6f} mm"
              f"{'' if good else '  BROKEN'}", flush=True)
    name = max(worst, key=worst.get)
    print(f"{len(worst)} systems, the largest difference is {worst[name]:.6f} mm in {name}; PROJ {pyproj.proj_version_str}")
    sys.exit(1 if broken else 0)


main()
