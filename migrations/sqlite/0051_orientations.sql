-- One row for every orientation that was asked for; the queue only says which of them to look at next.
CREATE TABLE orientations (
    id          BLOB PRIMARY KEY NOT NULL, -- UUIDv7
    image_id    BLOB NOT NULL REFERENCES images (id),
    camera_id   BLOB NOT NULL REFERENCES cameras (id),
    prepared    TEXT NOT NULL, -- JSON: the request with everything checked and filled in
    status      TEXT NOT NULL CHECK (status IN ('queued', 'running', 'succeeded', 'failed', 'cancelled')),
    stage       TEXT,
    progress    REAL NOT NULL DEFAULT 0,
    attempts    INTEGER NOT NULL DEFAULT 0,
    lease       BLOB, -- of the attempt under way: only its holder may write a result
    error_code  TEXT,
    error       TEXT,
    verdict     TEXT,
    result      TEXT, -- JSON, as the contract has it
    drawing     TEXT, -- JSON, what the overlay shows
    created_at  TEXT NOT NULL,
    started_at  TEXT,
    finished_at TEXT,
    CHECK ((status = 'succeeded') = (result IS NOT NULL))
) STRICT;

CREATE INDEX unfinished_orientations ON orientations (status) WHERE status IN ('queued', 'running');
CREATE INDEX orientations_by_image ON orientations (image_id);
CREATE INDEX orientations_by_verdict ON orientations (verdict) WHERE verdict IS NOT NULL;
