-- A film camera is a row of `cameras` like any other, so that whatever refers to cameras refers to both kinds. Its
-- definition is here, as JSON; its columns of a digital camera are 0. (SQLite cannot take back NOT NULL from a column
-- without making the table anew, to which orientations refer.)
ALTER TABLE cameras ADD COLUMN film TEXT;

-- Pictures of fiducial marks that users cut from scans.
CREATE TABLE mark_templates (
    id            BLOB PRIMARY KEY NOT NULL, -- UUIDv7
    name          TEXT NOT NULL UNIQUE,
    width_px      INTEGER NOT NULL,
    height_px     INTEGER NOT NULL,
    grey          BLOB NOT NULL CHECK (length(grey) = 2 * width_px * height_px), -- little-endian u16, bright on dark
    pixel_size_um REAL NOT NULL,
    centre_x_px   REAL NOT NULL,
    centre_y_px   REAL NOT NULL,
    dont_care     TEXT NOT NULL, -- JSON: rectangles [x, y, width, height]
    negative      INTEGER NOT NULL, -- whether it came from a negative
    created_at    TEXT NOT NULL
) STRICT;

-- What a film camera needs must stay.
CREATE TABLE camera_mark_templates (
    camera_id   BLOB NOT NULL REFERENCES cameras (id) ON DELETE CASCADE,
    template_id BLOB NOT NULL REFERENCES mark_templates (id),
    PRIMARY KEY (camera_id, template_id)
) STRICT, WITHOUT ROWID;

CREATE INDEX cameras_by_mark_template ON camera_mark_templates (template_id);
