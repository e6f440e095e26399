CREATE TABLE cameras (
    id                    BLOB PRIMARY KEY NOT NULL, -- UUIDv7
    name                  TEXT NOT NULL UNIQUE,
    width_px              INTEGER NOT NULL,
    height_px             INTEGER NOT NULL,
    principal_distance_px REAL NOT NULL,
    principal_point_x_px  REAL NOT NULL,
    principal_point_y_px  REAL NOT NULL,
    k1                    REAL NOT NULL,
    k2                    REAL NOT NULL,
    k3                    REAL NOT NULL,
    p1                    REAL NOT NULL,
    p2                    REAL NOT NULL,
    b1_px                 REAL NOT NULL,
    b2_px                 REAL NOT NULL,
    created_at            TEXT NOT NULL
) STRICT;
