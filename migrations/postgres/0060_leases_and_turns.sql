-- Whose attempt is under way, and until when nobody else may take it up.
ALTER TABLE orientations ADD COLUMN worker UUID; -- of the process, a UUIDv7
ALTER TABLE orientations ADD COLUMN lease_until_ms BIGINT; -- since 1970, by the clock of the database
-- How the process of the last attempt ended, if it did not end the attempt.
ALTER TABLE orientations ADD COLUMN fate TEXT;

-- The order of the waiting: first by priority, then by turn. Those of one lane (a block, or a caller) have turns one after
-- the other, and each lane begins at the turn that is being worked on: no lane waits for the whole of another.
ALTER TABLE orientations ADD COLUMN lane TEXT COLLATE "C" NOT NULL DEFAULT '';
ALTER TABLE orientations ADD COLUMN priority BIGINT NOT NULL DEFAULT 1 CHECK (priority IN (0, 1, 2));
ALTER TABLE orientations ADD COLUMN turn BIGINT NOT NULL DEFAULT 0;

CREATE INDEX waiting_by_turn ON orientations (priority, turn) WHERE status = 'queued';
CREATE INDEX waiting_by_lane ON orientations (lane, turn) WHERE status = 'queued';
CREATE INDEX running_by_lease ON orientations (lease_until_ms) WHERE status = 'running';
