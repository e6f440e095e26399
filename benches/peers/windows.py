"""F3: windows out of a tiled TIFF with GDAL. `windows.py make FILE SIDE PICTURE`
writes such a file: the picture beside and below itself, 256 x 256 tiles, Deflate with predictor, as GDAL does it."""
import sys, warnings
from peer import array, serve
import numpy as np
import rasterio, rasterio.errors
from rasterio.windows import Window

warnings.filterwarnings("ignore", category=rasterio.errors.NotGeoreferencedWarning)


def make(path, side, picture):
    with rasterio.open(picture) as source:
        grey = source.read(1)
    repeats = [-(-side // n) for n in grey.shape]
    grey = np.tile(grey, repeats)[:side, :side]
    profile = {"driver": "GTiff", "width": side, "height": side, "count": 1, "dtype": "uint8", "tiled": True,
               "blockxsize": 256, "blockysize": 256, "compress": "deflate", "predictor": 2}
    with rasterio.open(path, "w", **profile) as target:
        target.write(grey, 1)


if sys.argv[1] == "make":
    make(sys.argv[2], int(sys.argv[3]), sys.argv[4])
    sys.exit()
windows = [tuple(int(n) for n in row) for row in array(sys.argv[1], "windows", 4)]


def run(path):
    total = 0
    with rasterio.open(path) as source:
        for window in windows:
            total += int(source.read(1, window=Window(*window)).sum(dtype=np.int64))
    return {"sum": total}


serve(run)
