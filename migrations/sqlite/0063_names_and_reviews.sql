-- What an image's file was called where it came from, and by which camera it was taken, if EXIF says.
ALTER TABLE images ADD COLUMN name TEXT;
ALTER TABLE images ADD COLUMN camera_model TEXT;

-- What staff have decided of an orientation; null while nobody has.
ALTER TABLE orientations ADD COLUMN review TEXT CHECK (review IN ('accepted', 'rejected'));
-- JSON: what lists show of the result's diagnosis, score, probability_correct and reasons.
ALTER TABLE orientations ADD COLUMN diagnosis TEXT;

-- Which orientations have a reason, by its code: for filters and statistics.
CREATE TABLE orientation_reasons (
    code           TEXT NOT NULL,
    orientation_id BLOB NOT NULL REFERENCES orientations (id) ON DELETE CASCADE,
    PRIMARY KEY (code, orientation_id)
) STRICT, WITHOUT ROWID;

CREATE INDEX orientation_reasons_by_orientation ON orientation_reasons (orientation_id);

-- the merge leaves out what is null
UPDATE orientations SET diagnosis = json_patch('{}', json_object(
    'score', result -> '$.diagnosis.score',
    'probability_correct', result -> '$.diagnosis.probability_correct',
    'reasons', COALESCE(result -> '$.diagnosis.reasons', json('[]'))
)) WHERE result IS NOT NULL AND json_valid(result);

INSERT INTO orientation_reasons (code, orientation_id)
SELECT DISTINCT reason.value ->> '$.code', orientations.id
FROM orientations, json_each(orientations.diagnosis, '$.reasons') AS reason
WHERE orientations.diagnosis IS NOT NULL AND reason.value ->> '$.code' IS NOT NULL;

CREATE INDEX orientations_by_review ON orientations (review, id) WHERE review IS NOT NULL;
CREATE INDEX orientations_to_review ON orientations (id) WHERE status = 'succeeded' AND review IS NULL;
DROP INDEX orientations_by_camera;
CREATE INDEX orientations_by_camera ON orientations (camera_id, id);
