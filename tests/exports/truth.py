"""The true orientation of a simulated scene in the form of a result: `truth.py FOLDER > result.json`."""

import json
import pathlib
import sys

truth = json.loads(pathlib.Path(sys.argv[1], "truth.json").read_text())
frame = truth["frame"]
print(json.dumps({"result": {
    "projection_centre": {"crs": frame, "coordinates": truth["projection_centre"]},
    "rotation": {"frame": frame, "rotation_matrix": truth["rotation_matrix"]},
    "ground_precision": [{"ground": [*truth["projection_centre"][:2], truth["ground_height_m"]]}],
}}))
