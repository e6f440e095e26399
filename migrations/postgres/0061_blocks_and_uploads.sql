-- The file of an image that was removed is gone; its row stays, for the orientations that refer to it.
ALTER TABLE images ADD COLUMN deleted_at TIMESTAMPTZ;

-- Flights: images that are oriented alike.
CREATE TABLE blocks (
    id         UUID PRIMARY KEY, -- UUIDv7
    name       TEXT COLLATE "C" NOT NULL,
    settings   TEXT NOT NULL, -- JSON: the request of an orientation, without image and approximation
    crs        TEXT NOT NULL, -- that of the list
    images     BIGINT NOT NULL,
    created_at TIMESTAMPTZ NOT NULL
);

CREATE TABLE block_images (
    block_id       UUID NOT NULL REFERENCES blocks (id) ON DELETE CASCADE,
    number         BIGINT NOT NULL, -- from 1, as listed
    name           TEXT COLLATE "C" NOT NULL,
    approximation  TEXT NOT NULL, -- JSON, as in the request of an orientation
    sha256         BYTEA CHECK (length(sha256) = 32), -- of the file, if the list says
    image_id       UUID REFERENCES images (id),
    orientation_id UUID REFERENCES orientations (id) ON DELETE SET NULL,
    PRIMARY KEY (block_id, number),
    UNIQUE (block_id, name)
);

CREATE INDEX block_images_by_orientation ON block_images (orientation_id) WHERE orientation_id IS NOT NULL;
CREATE INDEX block_images_by_image ON block_images (image_id) WHERE image_id IS NOT NULL;

-- Uploads that can be resumed. Their bytes are the file incoming/<id>, of which the first `received_bytes` are on disk for
-- certain; once it is whole it becomes an image.
CREATE TABLE uploads (
    id             UUID PRIMARY KEY, -- UUIDv7
    length_bytes   BIGINT NOT NULL,
    received_bytes BIGINT NOT NULL DEFAULT 0,
    metadata       TEXT NOT NULL, -- JSON: what the client says of the file
    image_id       UUID REFERENCES images (id),
    done           BOOLEAN NOT NULL DEFAULT FALSE, -- nothing is left to do: the image is kept, and attached to its block
    created_at     TIMESTAMPTZ NOT NULL,
    expires_at     TIMESTAMPTZ NOT NULL
);

CREATE INDEX uploads_by_expiry ON uploads (expires_at);

CREATE INDEX images_by_age ON images (created_at) WHERE deleted_at IS NULL;
CREATE INDEX orientations_by_end ON orientations (finished_at) WHERE finished_at IS NOT NULL;
