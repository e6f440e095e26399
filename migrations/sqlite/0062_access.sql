-- A key may end by itself. When it was last used is noted at most once a minute.
ALTER TABLE keys ADD COLUMN expires_at TEXT;
ALTER TABLE keys ADD COLUMN last_used_at TEXT;

-- People with a password.
CREATE TABLE accounts (
    id          BLOB PRIMARY KEY NOT NULL, -- UUIDv7
    name        TEXT NOT NULL UNIQUE,
    role        TEXT NOT NULL CHECK (role IN ('reader', 'operator', 'admin')),
    password    TEXT NOT NULL, -- Argon2id, as a PHC string
    created_at  TEXT NOT NULL,
    disabled_at TEXT
) STRICT;

-- Who is logged in. The cookie itself is never stored: only its SHA-256.
CREATE TABLE sessions (
    sha256     BLOB PRIMARY KEY NOT NULL CHECK (length(sha256) = 32),
    account_id BLOB NOT NULL REFERENCES accounts (id) ON DELETE CASCADE,
    created_at TEXT NOT NULL,
    used_at    TEXT NOT NULL
) STRICT;

CREATE INDEX sessions_by_account ON sessions (account_id);

-- Who has changed what, and what was refused. Each row's hash covers the row before.
CREATE TABLE audit (
    number     INTEGER PRIMARY KEY, -- 1, 2, 3, without gaps
    at         TEXT NOT NULL,
    who        TEXT NOT NULL,
    action     TEXT NOT NULL,
    object     TEXT NOT NULL,
    status     INTEGER NOT NULL,
    request_id TEXT NOT NULL,
    sha256     BLOB NOT NULL CHECK (length(sha256) = 32)
) STRICT;

CREATE INDEX audit_by_who ON audit (who, number);

CREATE TRIGGER audit_is_not_changed BEFORE UPDATE ON audit
BEGIN
    SELECT RAISE(ABORT, 'the audit log is append-only');
END;

CREATE TRIGGER audit_is_not_shortened BEFORE DELETE ON audit
BEGIN
    SELECT RAISE(ABORT, 'the audit log is append-only');
END;

-- Who is told when an orientation has ended. The row is made in the transaction that ends it.
ALTER TABLE orientations ADD COLUMN webhook TEXT;

CREATE TABLE webhooks (
    id             BLOB PRIMARY KEY NOT NULL, -- UUIDv7, of the event: the same in every try
    orientation_id BLOB NOT NULL UNIQUE REFERENCES orientations (id) ON DELETE CASCADE,
    url            TEXT NOT NULL,
    created_at     TEXT NOT NULL,
    attempts       INTEGER NOT NULL DEFAULT 0,
    begun_at_ms    INTEGER NOT NULL, -- since when it is tried, by the clock of the database
    next_at_ms     INTEGER NOT NULL,
    delivered_at   TEXT,
    given_up_at    TEXT,
    last_error     TEXT
) STRICT;

CREATE INDEX webhooks_due ON webhooks (next_at_ms) WHERE delivered_at IS NULL AND given_up_at IS NULL;

-- What the service has drawn for itself, such as the secret that signs webhooks.
CREATE TABLE secrets (
    name  TEXT PRIMARY KEY NOT NULL,
    value TEXT NOT NULL
) STRICT;
