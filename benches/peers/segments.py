"""F1: OpenCV's LSD with refine=STD over square windows of grey values."""
import os, sys
from peer import array, serve
import cv2
import numpy as np

cv2.setNumThreads(1)
folder = sys.argv[1]
side = int(array(folder, "side", 1)[0, 0])
windows = np.fromfile(os.path.join(folder, "windows"), np.uint8).reshape(-1, side, side)
detector = cv2.createLineSegmentDetector(cv2.LSD_REFINE_STD)


def run(_):
    return [detector.detect(window)[0] for window in windows]


def told(found):
    # OpenCV's pixel centres are whole numbers
    return {"found": [[] if lines is None else (lines.reshape(-1, 4).astype(float) + 0.5).tolist() for lines in found]}


serve(run, told)
