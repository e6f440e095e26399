-- What the verdict of an orientation rested on: JSON, for learning from it once its image has a reference.
ALTER TABLE orientations ADD COLUMN record TEXT;

-- Where the camera truly was, from a bundle adjustment: geocentric, so that it serves every orientation of the image.
CREATE TABLE reference_orientations (
    image_id   BLOB PRIMARY KEY NOT NULL REFERENCES images (id),
    area       TEXT NOT NULL, -- the block or flight: what is kept apart when classifiers are compared
    centre_x_m REAL NOT NULL,
    centre_y_m REAL NOT NULL,
    centre_z_m REAL NOT NULL,
    rotation   BLOB NOT NULL CHECK (length(rotation) = 72), -- camera from geocentric: nine little-endian f64, row by row
    updated_at TEXT NOT NULL
) STRICT;

-- A classifier is ready when its three texts are there; while it is trained the row says how far that is.
CREATE TABLE classifiers (
    id          BLOB PRIMARY KEY NOT NULL, -- UUIDv7
    name        TEXT NOT NULL UNIQUE,
    status      TEXT NOT NULL CHECK (status IN ('queued', 'training', 'ready', 'failed')),
    progress    REAL NOT NULL DEFAULT 0,
    plan        TEXT NOT NULL, -- JSON: what was asked for
    sha256      BLOB CHECK (length(sha256) = 32), -- of the three texts
    model       TEXT, -- LIBSVM's model file
    scaling     TEXT, -- svm-scale's file of ranges
    description TEXT, -- JSON: kind, features, calibration, domain, provenance
    error       TEXT,
    created_at  TEXT NOT NULL,
    finished_at TEXT,
    CHECK ((status = 'ready') = (sha256 IS NOT NULL AND model IS NOT NULL AND scaling IS NOT NULL AND description IS NOT NULL))
) STRICT;

-- The last row says which classifier decides; a null that it is the one that the program brings along.
CREATE TABLE classifier_activations (
    number        INTEGER PRIMARY KEY,
    classifier_id BLOB REFERENCES classifiers (id),
    activated_at  TEXT NOT NULL
) STRICT;

-- What became of the control points that accepted images should show.
CREATE TABLE sightings (
    control_point  TEXT NOT NULL,
    orientation_id BLOB NOT NULL REFERENCES orientations (id) ON DELETE CASCADE,
    image_id       BLOB NOT NULL REFERENCES images (id),
    outcome        TEXT NOT NULL CHECK (outcome IN ('found', 'missed', 'contradicts')),
    seen_at        TEXT NOT NULL,
    PRIMARY KEY (control_point, orientation_id)
) STRICT, WITHOUT ROWID;

CREATE INDEX sightings_by_orientation ON sightings (orientation_id);

CREATE INDEX orientations_with_record ON orientations (image_id) WHERE record IS NOT NULL;
