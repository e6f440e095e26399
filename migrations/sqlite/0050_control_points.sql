-- Control points: a building's roof edges in geocentric coordinates (metres, f64).
-- `edges` holds six little-endian f64 an edge: start x, y, z, end x, y, z.
CREATE TABLE control_points (
    id INTEGER PRIMARY KEY,
    name TEXT NOT NULL UNIQUE,
    sigma_m REAL NOT NULL CHECK (sigma_m > 0),
    reference_x_m REAL NOT NULL,
    reference_y_m REAL NOT NULL,
    reference_z_m REAL NOT NULL,
    edges BLOB NOT NULL
) STRICT;

-- The box of a control point in longitude and latitude. The R*Tree rounds to 32-bit floats, outward: every answer is
-- filtered exactly afterwards.
CREATE VIRTUAL TABLE control_point_boxes USING rtree(id, min_lon_deg, max_lon_deg, min_lat_deg, max_lat_deg);
