-- Control scenes: small pictures of the ground with one reference point in geocentric coordinates (metres, f64).
CREATE TABLE control_scenes (
    id                          INTEGER PRIMARY KEY, -- that of its box
    public_id                   BLOB NOT NULL UNIQUE, -- UUIDv7
    name                        TEXT NOT NULL UNIQUE,
    width_px                    INTEGER NOT NULL,
    height_px                   INTEGER NOT NULL,
    gsd_m                       REAL NOT NULL CHECK (gsd_m > 0),
    azimuth_of_image_up_deg     REAL NOT NULL, -- clockwise from true north
    sigma_azimuth_deg           REAL NOT NULL CHECK (sigma_azimuth_deg > 0),
    reference_column_px         REAL NOT NULL, -- from the corner of the top-left pixel
    reference_row_px            REAL NOT NULL,
    reference_x_m               REAL NOT NULL,
    reference_y_m               REAL NOT NULL,
    reference_z_m               REAL NOT NULL,
    sigma_m                     REAL NOT NULL CHECK (sigma_m > 0),
    media_type                  TEXT NOT NULL,
    size_bytes                  INTEGER NOT NULL,
    sha256                      BLOB NOT NULL CHECK (length(sha256) = 32),
    created_at                  TEXT NOT NULL,
    updated_at                  TEXT NOT NULL
) STRICT;

-- The files of their pictures, as they were uploaded: apart, so that who looks for scenes reads none of them.
CREATE TABLE control_scene_pictures (
    scene_id INTEGER PRIMARY KEY REFERENCES control_scenes (id) ON DELETE CASCADE,
    file     BLOB NOT NULL
) STRICT;

-- What a scene shows, in longitude and latitude; rounded outward to 32-bit floats, as the boxes of control points.
CREATE VIRTUAL TABLE control_scene_boxes USING rtree(id, min_lon_deg, max_lon_deg, min_lat_deg, max_lat_deg);
