-- A key itself is never stored: only its SHA-256. A revoked key keeps its row, so that its use stays explicable.
CREATE TABLE keys (
    id         BLOB PRIMARY KEY NOT NULL, -- UUIDv7
    name       TEXT NOT NULL,
    role       TEXT NOT NULL CHECK (role IN ('reader', 'operator', 'admin')),
    sha256     BLOB NOT NULL UNIQUE CHECK (length(sha256) = 32),
    created_at TEXT NOT NULL,
    revoked_at TEXT
) STRICT;
