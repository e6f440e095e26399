-- A key may end by itself. When it was last used is noted at most once a minute.
ALTER TABLE keys ADD COLUMN expires_at TIMESTAMPTZ;
ALTER TABLE keys ADD COLUMN last_used_at TIMESTAMPTZ;

-- People with a password.
CREATE TABLE accounts (
    id          UUID PRIMARY KEY, -- UUIDv7
    name        TEXT COLLATE "C" NOT NULL UNIQUE,
    role        TEXT NOT NULL CHECK (role IN ('reader', 'operator', 'admin')),
    password    TEXT NOT NULL, -- Argon2id, as a PHC string
    created_at  TIMESTAMPTZ NOT NULL,
    disabled_at TIMESTAMPTZ
);

-- Who is logged in. The cookie itself is never stored: only its SHA-256.
CREATE TABLE sessions (
    sha256     BYTEA PRIMARY KEY CHECK (length(sha256) = 32),
    account_id UUID NOT NULL REFERENCES accounts (id) ON DELETE CASCADE,
    created_at TIMESTAMPTZ NOT NULL,
    used_at    TIMESTAMPTZ NOT NULL
);

CREATE INDEX sessions_by_account ON sessions (account_id);

-- Who has changed what, and what was refused. Each row's hash covers the row before.
CREATE TABLE audit (
    number     BIGINT PRIMARY KEY, -- 1, 2, 3, without gaps
    at         TIMESTAMPTZ NOT NULL,
    who        TEXT COLLATE "C" NOT NULL,
    action     TEXT NOT NULL,
    object     TEXT NOT NULL,
    status     BIGINT NOT NULL,
    request_id TEXT NOT NULL,
    sha256     BYTEA NOT NULL CHECK (length(sha256) = 32)
);

CREATE INDEX audit_by_who ON audit (who, number);

CREATE FUNCTION audit_is_append_only() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
    RAISE EXCEPTION 'the audit log is append-only';
END;
$$;

CREATE TRIGGER audit_is_not_changed BEFORE UPDATE OR DELETE OR TRUNCATE ON audit
    FOR EACH STATEMENT EXECUTE FUNCTION audit_is_append_only();

-- Who is told when an orientation has ended. The row is made in the transaction that ends it.
ALTER TABLE orientations ADD COLUMN webhook TEXT;

CREATE TABLE webhooks (
    id             UUID PRIMARY KEY, -- UUIDv7, of the event: the same in every try
    orientation_id UUID NOT NULL UNIQUE REFERENCES orientations (id) ON DELETE CASCADE,
    url            TEXT NOT NULL,
    created_at     TIMESTAMPTZ NOT NULL,
    attempts       BIGINT NOT NULL DEFAULT 0,
    begun_at_ms    BIGINT NOT NULL, -- since when it is tried, by the clock of the database
    next_at_ms     BIGINT NOT NULL,
    delivered_at   TIMESTAMPTZ,
    given_up_at    TIMESTAMPTZ,
    last_error     TEXT
);

CREATE INDEX webhooks_due ON webhooks (next_at_ms) WHERE delivered_at IS NULL AND given_up_at IS NULL;

-- What the service has drawn for itself, such as the secret that signs webhooks.
CREATE TABLE secrets (
    name  TEXT PRIMARY KEY,
    value TEXT NOT NULL
);
