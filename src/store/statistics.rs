//! What has become of orientations, step by step in time.

use chrono::{DateTime, Utc};
use sqlx::FromRow;

use super::{Store, StoreError};
use crate::database::{Dialects, query};

/// The most codes that are told of one kind.
const CODES_MAX: u32 = 20;

/// How long a step is. Steps begin at full hours and days of UTC.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Step {
    /// An hour.
    Hour,
    /// A day.
    Day,
}

impl Step {
    /// Its length.
    #[must_use]
    pub fn seconds(self) -> i64 {
        match self {
            Self::Hour => 3600,
            Self::Day => 86_400,
        }
    }

    /// The number of the step that a time lies in.
    #[must_use]
    pub fn number(self, time: DateTime<Utc>) -> i64 {
        time.timestamp().div_euclid(self.seconds())
    }
}

/// A part of time, without its end.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Span {
    /// Its begin.
    pub since: DateTime<Utc>,
    /// Its end.
    pub until: DateTime<Utc>,
}

/// How many orientations of a step have what in common.
#[derive(Debug, Clone, PartialEq, Eq, FromRow)]
pub struct Tally {
    /// The step that they were asked for in, or have ended in.
    pub number: i64,
    /// How they have ended; none of those that were asked for.
    pub ended: Option<String>,
    /// The verdict of those that have one.
    pub verdict: Option<String>,
    /// What staff have decided of them.
    pub review: Option<String>,
    /// Why those have failed that have.
    pub error_code: Option<String>,
    /// How many.
    pub count: i64,
}

/// What waits, for a worker or for staff, and what runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, FromRow)]
pub struct Present {
    /// How many wait.
    pub queued: i64,
    /// How many run.
    pub running: i64,
    /// When the one was asked for that has waited for longest.
    pub oldest_queued_at: Option<DateTime<Utc>>,
    /// Yellow ones that nobody has decided about.
    pub doubtful: i64,
}

/// How long attempts have taken.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Durations {
    /// Half of them at most so long.
    pub median_s: f64,
    /// 19 of 20 at most so long.
    pub p95_s: f64,
}

impl Store {
    /// Orientations asked for in a span, and those that have ended in it, counted by step.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn tallies(&self, span: Span, step: Step) -> Result<Vec<Tally>, StoreError> {
        let tallies = query(self.database.dialect(TALLIES)).bind(span.since).bind(span.until).bind(step.seconds());
        Ok(tallies.fetch_all(&self.database).await?)
    }

    /// What waits, for a worker or for staff, and what runs.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn present(&self) -> Result<Present, StoreError> {
        let present = query(
            "SELECT count(*) FILTER (WHERE status = 'queued') AS queued,
             count(*) FILTER (WHERE status = 'running') AS running,
             min(created_at) FILTER (WHERE status = 'queued') AS oldest_queued_at,
             (SELECT count(*) FROM orientations WHERE verdict = 'yellow' AND review IS NULL) AS doubtful
             FROM orientations WHERE status IN ('queued', 'running')",
        );
        Ok(present.fetch_one(&self.database).await?)
    }

    /// How long the attempts have taken that have ended in a span; `None` without any.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn durations(&self, span: Span) -> Result<Option<Durations>, StoreError> {
        let durations = query(self.database.dialect(DURATIONS)).bind(span.since).bind(span.until);
        let (median_s, p95_s): (Option<f64>, Option<f64>) = durations.fetch_one(&self.database).await?;
        Ok(median_s.zip(p95_s).map(|(median_s, p95_s)| Durations { median_s, p95_s }))
    }

    /// The reasons of the verdicts in a span by their codes, the most frequent ones first.
    ///
    /// # Errors
    /// [`StoreError::Database`].
    pub async fn reasons(&self, span: Span) -> Result<Vec<(String, i64)>, StoreError> {
        let reasons = query(
            "SELECT code, count(*) FROM orientations JOIN orientation_reasons ON orientation_id = id
             WHERE finished_at >= $1 AND finished_at < $2 GROUP BY code ORDER BY count(*) DESC, code LIMIT $3",
        );
        Ok(reasons.bind(span.since).bind(span.until).bind(CODES_MAX).fetch_all(&self.database).await?)
    }
}

/// Parameters: begin and end of the span, seconds of a step. SQLite would round the fraction of a second up.
const TALLIES: Dialects = Dialects {
    sqlite: "SELECT CAST(strftime('%s', substr(created_at, 1, 19)) AS INTEGER) / $3 AS number, NULL AS ended,
                    NULL AS verdict, NULL AS review, NULL AS error_code, count(*) AS count
             FROM orientations WHERE created_at >= $1 AND created_at < $2 GROUP BY 1
             UNION ALL
             SELECT CAST(strftime('%s', substr(finished_at, 1, 19)) AS INTEGER) / $3, status, verdict, review, error_code,
                    count(*)
             FROM orientations WHERE finished_at >= $1 AND finished_at < $2 GROUP BY 1, 2, 3, 4, 5",
    postgres: "SELECT CAST(floor(extract(epoch FROM created_at) / $3) AS BIGINT) AS number, NULL AS ended,
                      NULL AS verdict, NULL AS review, NULL AS error_code, count(*) AS count
               FROM orientations WHERE created_at >= $1 AND created_at < $2 GROUP BY 1
               UNION ALL
               SELECT CAST(floor(extract(epoch FROM finished_at) / $3) AS BIGINT), status, verdict, review, error_code,
                      count(*)
               FROM orientations WHERE finished_at >= $1 AND finished_at < $2 GROUP BY 1, 2, 3, 4, 5",
};

/// The least of the durations that this share of all does not exceed.
const DURATIONS: Dialects = Dialects {
    sqlite: "WITH lasted AS (
                 SELECT (julianday(finished_at) - julianday(started_at)) * 86400.0 AS seconds FROM orientations
                 WHERE finished_at >= $1 AND finished_at < $2 AND status IN ('succeeded', 'failed')
                     AND started_at IS NOT NULL),
             ranked AS (SELECT seconds, row_number() OVER (ORDER BY seconds) AS place, count(*) OVER () AS n FROM lasted)
             SELECT min(seconds) FILTER (WHERE place >= 0.5 * n), min(seconds) FILTER (WHERE place >= 0.95 * n)
             FROM ranked",
    postgres: "WITH lasted AS (
                   SELECT CAST(extract(epoch FROM finished_at - started_at) AS DOUBLE PRECISION) AS seconds
                   FROM orientations
                   WHERE finished_at >= $1 AND finished_at < $2 AND status IN ('succeeded', 'failed')
                       AND started_at IS NOT NULL),
               ranked AS (SELECT seconds, row_number() OVER (ORDER BY seconds) AS place, count(*) OVER () AS n FROM lasted)
               SELECT min(seconds) FILTER (WHERE place >= 0.5 * n), min(seconds) FILTER (WHERE place >= 0.95 * n)
               FROM ranked",
};

#[cfg(test)]
mod tests;
