"""Ortho-photos of real photographs of the benchmark whose orientation is accepted, by orthority on level ground, against those
lines of the control that lie on that ground: `real.py GABLE [DATASET]`. The common shift must stay within the tolerance."""

import json
import pathlib
import subprocess
import sys
import tempfile

import numpy as np
import rasterio

GRID = "EPSG:32614"
# lines so near the level ground count: beside it they lean away from the camera
BAND_M = 0.12


def run(*command, **more):
    return subprocess.run([str(word) for word in command], capture_output=True, text=True, **more)


def plane(path, centre, height):
    """An elevation model that is level."""
    east, north = centre
    with rasterio.open(path, "w", driver="GTiff", width=400, height=400, count=1, dtype="float32", crs=GRID,
                       transform=rasterio.transform.from_origin(east - 200, north + 200, 1, 1)) as dem:
        dem.write(np.full((400, 400), height, "float32"), 1)


def main():
    gable = pathlib.Path(sys.argv[1]).resolve()
    here = pathlib.Path(__file__).resolve().parent
    dataset = pathlib.Path(sys.argv[2] if len(sys.argv) > 2 else here.parents[2] / "shared/bench/caliterra")
    if not dataset.is_dir():
        print(f"skipped: {dataset} is not there")
        return
    about = json.loads((dataset / "dataset.json").read_text())
    origin_height = float(about["frame"].split("+h_0=")[1].split()[0])
    ground = origin_height + about["ground_height_m"]
    tolerance_m, failed, tried = about["tolerance_gsd"] * about["gsd_m"], False, 0
    with tempfile.TemporaryDirectory() as folder:
        work = pathlib.Path(folder)
        for image in json.loads((dataset / "images.json").read_text()):
            (work / "approximation.json").write_text(json.dumps(image["approximations"]["attitude"]))
            oriented = run(gable, "orient", dataset / "images" / image["file"], "--camera", dataset / "camera.json", "--control",
                           dataset / "control_points.geojson", "--crs", about["control_crs"], "--approximation", work / "approximation.json",
                           "--output-crs", GRID, "--json", check=True).stdout
            result = json.loads(oriented)["result"]
            if result["diagnosis"]["verdict"] != "green":
                continue
            tried += 1
            (work / "result.json").write_text(oriented)
            plane(work / "dem.tif", result["projection_centre"]["coordinates"][:2], ground)
            made = run(gable, "ortho", "make", dataset / "images" / image["file"], "--result", work / "result.json", "--camera",
                       dataset / "camera.json", "--dem", work / "dem.tif", "--crs", GRID, "--out", work / "ortho", "--oty",
                       pathlib.Path(sys.executable).with_name("oty"))
            ortho = work / "ortho" / (pathlib.Path(image["file"]).stem + "_ORTHO.tif")
            if not ortho.is_file():
                print(made.stderr[-500:])
                failed = True
                continue
            told = run(gable, "ortho", "check", ortho, "--edges", dataset / "control_points.geojson", "--crs", about["control_crs"],
                       "--heights-m", f"{ground - BAND_M},{ground + BAND_M}", "--search-m", "0.4", "--json")
            if told.returncode != 0:
                print(f"{image['file']}: no line of the ground in view: {told.stderr.strip().splitlines()[-1]}")
                continue
            told = json.loads(told.stdout)
            shift = float(np.linalg.norm(told["common_m"]))
            held = shift <= tolerance_m
            failed |= not held
            print(f"{image['file']}: {told['found']} of {told['tried']} lines on the ground: common shift {shift:.3f} m "
                  f"({shift / about['gsd_m']:.1f} GSD of {about['tolerance_gsd']:.0f} allowed), rms {told['rms_m']:.3f} m{'' if held else '   BROKEN'}")
    print(f"{tried} photographs were accepted")
    sys.exit(failed)


main()
