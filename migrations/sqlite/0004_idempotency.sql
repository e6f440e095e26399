-- One row for every Idempotency-Key of a credential. `status` is null while the first request is being answered.
CREATE TABLE idempotency (
    credential   TEXT NOT NULL,
    key          TEXT NOT NULL,
    resource_id  BLOB NOT NULL, -- the id that the request gives to what it makes: the same after a crash
    abandoned    INTEGER NOT NULL DEFAULT 0, -- the service ended before it had answered
    fingerprint  BLOB, -- SHA-256 of method, path, query, type and body
    status       INTEGER,
    content_type TEXT,
    location     TEXT,
    body         BLOB,
    created_at   TEXT NOT NULL,
    PRIMARY KEY (credential, key)
) STRICT;

CREATE INDEX idempotency_by_age ON idempotency (created_at);
