"""F5 to F7: poselib on the same scenes, from the same start. `quadruples` is a loop over all quadruples, each refined and
rated by the robust sum over all points; `ransac` the robust estimation with its defaults; `lines` the robust refinement
with points and lines."""
import itertools, os, sys
from peer import array, serve
import numpy as np
import poselib

folder, method = sys.argv[1:3]
focal, tolerance_px, count = array(folder, "parameters", 3)[0]
scenes = array(folder, "points", 5).reshape(-1, int(count), 5)  # X, Y, Z, x, y; the image about the principal point, y down
start = array(folder, "start", 12)[0]  # rotation to computer vision's camera frame, row by row; projection centre
rotation, centre = start[:9].reshape(3, 3), start[9:]
camera = {"model": "SIMPLE_PINHOLE", "width": 6000, "height": 4000, "params": [focal, 0.0, 0.0]}


def begin():
    pose = poselib.CameraPose()
    pose.R, pose.t = rotation, -rotation @ centre
    return pose


def robust_sum(pose, images, objects):
    seen = objects @ pose.R.T + pose.t
    return np.minimum(((seen[:, :2] / seen[:, 2:] * focal - images) ** 2).sum(1), tolerance_px**2).sum()


def quadruples(images, objects):
    best = None, np.inf
    for four in itertools.combinations(range(len(images)), 4):
        four = list(four)
        pose, _ = poselib.refine_absolute_pose(images[four], objects[four], begin(), camera, {"loss_type": "TRIVIAL"})
        rating = robust_sum(pose, images, objects)
        if rating < best[1]:
            best = pose, rating
    return best[0]


def ransac(images, objects):
    return poselib.estimate_absolute_pose(images, objects, camera)[0]


def lines(images, objects):
    loss = {"loss_type": "CAUCHY", "loss_scale": 3.0}
    return poselib.refine_absolute_pose_pnpl(images, objects, *line_images, *line_objects, begin(), camera, loss, loss)[0]


if method == "lines":
    ends = array(folder, "lines", 10)  # both ends in space, both in the image
    line_objects = [np.ascontiguousarray(ends[:, k : k + 3]) for k in (0, 3)]
    line_images = [np.ascontiguousarray(ends[:, k : k + 2]) for k in (6, 8)]
solve = {"quadruples": quadruples, "ransac": ransac, "lines": lines}[method]
scenes = [(np.ascontiguousarray(scene[:, 3:]), np.ascontiguousarray(scene[:, :3])) for scene in scenes]


def told(poses):
    return {"centres": [(-pose.R.T @ pose.t).tolist() for pose in poses]}


serve(lambda _: [solve(*scene) for scene in scenes], told)
