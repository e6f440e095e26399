"""F9: the plain Python pipeline of `../shared/bench/baseline`, an image for every line."""
import importlib.machinery, importlib.util, math, os, sys
from peer import serve
import contextlib

dataset = sys.argv[1]
loader = importlib.machinery.SourceFileLoader("baseline", os.path.join(dataset, "..", "baseline"))
sys.dont_write_bytecode = True  # the folder may be read-only
baseline = importlib.util.module_from_spec(importlib.util.spec_from_loader("baseline", loader))
loader.exec_module(baseline)
import numpy as np

data, camera = baseline.read(dataset, "dataset.json"), baseline.Camera(baseline.read(dataset, "camera.json"))
control = baseline.read_control_points(dataset, data, 0)
images = {image["file"]: image for image in baseline.read(dataset, "images.json")}


def run(file):
    image = images[file]
    approximation = image["approximations"]["attitude"]
    search = max(400.0, 3 * camera.focal * math.tan(math.radians(approximation["sigma_tilt_deg"])))
    path = os.path.join(dataset, data.get("images_folder", "images"), file)
    start = baseline.approximate_pose(approximation, data["frame"])
    pose, _ = baseline.orient(camera, control, path, start, search, data["ground_height_m"], lambda _: contextlib.nullcontext())
    return image, pose


def told(result):
    image, pose = result
    if pose is None:
        return {"d_max_gsd": None}
    given = image["reference"]
    reference = baseline.TO_COMPUTER_VISION @ np.array(given["rotation_matrix"]), np.array(given["projection_centre"])
    d_max = baseline.d_max(camera, data["ground_height_m"], pose, reference) / image["gsd_m"]
    return {"d_max_gsd": d_max if math.isfinite(d_max) else None}


serve(run, told)
