-- Named sets of control points that a request can choose among: an area, a survey.
CREATE TABLE control_sets (
    id          INTEGER PRIMARY KEY,
    name        TEXT NOT NULL UNIQUE,
    description TEXT,
    survey_year INTEGER,
    points      INTEGER NOT NULL DEFAULT 0, -- how many control points it has: to count ten million takes too long
    min_lon_deg REAL, -- a box around all that was imported, as long as there are any
    max_lon_deg REAL,
    min_lat_deg REAL,
    max_lat_deg REAL,
    created_at  TEXT NOT NULL
) STRICT;

INSERT INTO control_sets (id, name, description, points, min_lon_deg, max_lon_deg, min_lat_deg, max_lat_deg, created_at)
SELECT 1, 'default', 'where an import names no set', count(*), min(min_lon_deg), max(max_lon_deg), min(min_lat_deg),
       max(max_lat_deg), strftime('%Y-%m-%dT%H:%M:%S+00:00', 'now')
FROM control_point_boxes;

-- What was imported. An import of a file that was interrupted goes on where its last row was written.
CREATE TABLE control_imports (
    id         INTEGER PRIMARY KEY AUTOINCREMENT, -- never given again: control points bear it
    set_id     INTEGER NOT NULL REFERENCES control_sets (id) ON DELETE CASCADE,
    file       BLOB CHECK (length(file) = 32), -- what the file is known by; null of what does not come again
    items_done INTEGER NOT NULL DEFAULT 0, -- of the file, written or refused
    imported   INTEGER NOT NULL DEFAULT 0,
    updated    INTEGER NOT NULL DEFAULT 0,
    refused    INTEGER NOT NULL DEFAULT 0,
    began_at   TEXT NOT NULL,
    ended_at   TEXT
) STRICT;

CREATE INDEX unfinished_control_imports ON control_imports (file) WHERE ended_at IS NULL AND file IS NOT NULL;

-- Control points: a building's roof edges in geocentric coordinates (metres). A name is unique within its set: the same
-- building may be in the surveys of several years.
-- `edges`: see src/control/encoding.rs.
CREATE TABLE control_points_in_sets (
    id            INTEGER PRIMARY KEY, -- that of its box
    set_id        INTEGER NOT NULL REFERENCES control_sets (id),
    import_id     INTEGER NOT NULL DEFAULT 0, -- which import has last written it; 0 before imports were counted
    name          TEXT NOT NULL,
    is_check      INTEGER NOT NULL DEFAULT 0 CHECK (is_check IN (0, 1)), -- only checked with, never used
    valid_from    TEXT, -- first and last day on which it stands like this; null is open
    valid_to      TEXT,
    sigma_m       REAL NOT NULL CHECK (sigma_m > 0),
    reference_x_m REAL NOT NULL,
    reference_y_m REAL NOT NULL,
    reference_z_m REAL NOT NULL,
    edges         BLOB NOT NULL,
    UNIQUE (set_id, name)
) STRICT;

INSERT INTO control_points_in_sets (id, set_id, name, sigma_m, reference_x_m, reference_y_m, reference_z_m, edges)
SELECT id, 1, name, sigma_m, reference_x_m, reference_y_m, reference_z_m, edges FROM control_points;

DROP TABLE control_points;
ALTER TABLE control_points_in_sets RENAME TO control_points;

-- When it was taken, if EXIF says: which buildings stood then.
ALTER TABLE images ADD COLUMN taken_on TEXT;
