-- What staff have decided of orientations, one row each time; the latest one counts (`orientations.review`).
CREATE TABLE reviews (
    id             BLOB PRIMARY KEY NOT NULL, -- UUIDv7
    orientation_id BLOB NOT NULL REFERENCES orientations (id) ON DELETE CASCADE,
    decision       TEXT NOT NULL CHECK (decision IN ('accepted', 'rejected')),
    why            TEXT NOT NULL,
    who            TEXT NOT NULL, -- as in the audit log
    correction     TEXT, -- JSON: control points that were switched off or moved; null if nothing was corrected
    result         TEXT, -- JSON: what the correction leads to
    drawing        TEXT, -- JSON: what there is to see of that
    created_at     TEXT NOT NULL
) STRICT;

CREATE INDEX reviews_by_orientation ON reviews (orientation_id, id);

-- A reference that staff have given by accepting this orientation of the image, corrected or not; null for one from outside,
-- such as a block adjustment, which no decision of staff replaces.
ALTER TABLE reference_orientations ADD COLUMN by_review_of BLOB;

-- what was rejected is a label too
CREATE INDEX orientations_rejected ON orientations (id) WHERE review = 'rejected';
-- what waits for staff: to be counted
CREATE INDEX orientations_doubtful ON orientations (id) WHERE verdict = 'yellow' AND review IS NULL;
