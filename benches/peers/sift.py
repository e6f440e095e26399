"""F10: OpenCV's SIFT, and its brute-force matcher, on grey pictures that lie one after another in a file."""
import os, sys
from peer import array, serve
import cv2
import numpy as np

cv2.setNumThreads(1)
folder = sys.argv[1]
data = np.fromfile(os.path.join(folder, "pictures"), np.uint8)
pictures, start = [], 0
for width, height in array(folder, "sizes", 2).astype(int):
    pictures.append(data[start : start + width * height].reshape(height, width))
    start += width * height
timed = array(folder, "timed", 1).astype(int)[:, 0]
pairs = array(folder, "pairs", 2).astype(int)
detector = cv2.SIFT_create()
matcher = cv2.BFMatcher(cv2.NORM_L2)
found = []


def run(line):
    if line == "points":
        return [detector.detectAndCompute(pictures[k], None) for k in timed]
    if not found:  # in the first run, which is not timed
        found.extend(detector.detectAndCompute(picture, None) for picture in pictures)
    return [matcher.knnMatch(found[a][1], found[b][1], 2) for a, b in pairs]


def told(result):
    if isinstance(result[0][0][0], cv2.KeyPoint):
        return {"points": [len(points) for points, _ in result]}
    matches = []
    for (a, b), twos in zip(pairs, result):
        at = [found[a][0][m.queryIdx].pt + found[b][0][m.trainIdx].pt for m, _ in twos]
        ratios = [m.distance / max(n.distance, 1e-9) for m, n in twos]
        # OpenCV's pixel centres are whole numbers, and its doubled picture lies a quarter of a pixel off
        matches.append([[x + 0.75 for x in p] + [r] for p, r in zip(at, ratios)])
    return {"matches": matches}


serve(run, told)
