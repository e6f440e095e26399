-- The bytes of an image are the file images/<sha256> in the data folder; a row is made only when that file is complete.
CREATE TABLE images (
    id            BLOB PRIMARY KEY NOT NULL, -- UUIDv7
    sha256        BLOB NOT NULL UNIQUE CHECK (length(sha256) = 32),
    size_bytes    INTEGER NOT NULL,
    format        TEXT NOT NULL CHECK (format IN ('jpeg', 'png', 'tiff')),
    width_px      INTEGER NOT NULL,
    height_px     INTEGER NOT NULL,
    longitude_deg REAL,
    latitude_deg  REAL,
    height_m      REAL, -- above the geoid, as EXIF gives it
    created_at    TEXT NOT NULL
) STRICT;
