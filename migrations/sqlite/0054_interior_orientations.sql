-- Interior orientations of scanned film that were asked for; they are worked out at once, so each row has its result.
CREATE TABLE interior_orientations (
    id          BLOB PRIMARY KEY NOT NULL, -- UUIDv7
    image_id    BLOB NOT NULL REFERENCES images (id),
    camera_id   BLOB NOT NULL REFERENCES cameras (id),
    prepared    TEXT NOT NULL, -- JSON: the request with everything checked and filled in
    verdict     TEXT NOT NULL CHECK (verdict IN ('green', 'yellow', 'red')),
    result      TEXT NOT NULL, -- JSON, as the contract has it
    created_at  TEXT NOT NULL
) STRICT;

CREATE INDEX interior_orientations_by_image ON interior_orientations (image_id);
CREATE INDEX interior_orientations_by_camera ON interior_orientations (camera_id);
