//! Lists, a page at a time.

use serde::{Deserialize, Serialize};
use utoipa::{IntoParams, ToSchema};
use uuid::Uuid;

use super::problem::Problem;

/// The most items on a page.
pub const LIMIT_MAX: u32 = 200;
/// Items on a page if the client does not say.
pub const LIMIT_DEFAULT: u32 = 50;

/// One page of a list.
#[derive(Debug, Serialize, ToSchema)]
pub struct Page<T> {
    /// The items, the newest first.
    pub items: Vec<T>,
    /// Give it as `cursor` to get the next page; `null` on the last one.
    pub next_cursor: Option<String>,
}

/// The parameters of a list that has no others.
#[derive(Debug, Deserialize, IntoParams)]
#[serde(deny_unknown_fields)]
#[into_params(parameter_in = Query)]
pub struct PageQuery {
    /// Items on a page, from 1 to 200; 50 if left out.
    #[param(minimum = 1, maximum = 200)]
    limit: Option<u32>,
    /// `next_cursor` of the page before.
    #[param(min_length = 1)]
    cursor: Option<String>,
}

impl PageQuery {
    /// Which page is wanted.
    ///
    /// # Errors
    /// 422 if the parameters make no sense.
    pub fn wanted(&self) -> Result<Wanted, Problem> {
        Wanted::new(self.limit, self.cursor.as_deref())
    }

    /// How many items are wanted, of a list with cursors of its own.
    ///
    /// # Errors
    /// 422 if there are none or too many.
    pub fn limit(&self) -> Result<u32, Problem> {
        Ok(Wanted::new(self.limit, None)?.limit)
    }

    /// Where the page begins, of a list with cursors of its own.
    #[must_use]
    pub fn cursor(&self) -> Option<&str> {
        self.cursor.as_deref()
    }
}

/// Which page is wanted, of a list ordered by falling UUIDv7.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Wanted {
    /// Only items with an id below this one.
    pub before: Option<Uuid>,
    /// Items on the page.
    pub limit: u32,
}

impl Wanted {
    /// Understands the parameters `limit` and `cursor`.
    ///
    /// # Errors
    /// 422 if they make no sense.
    pub fn new(limit: Option<u32>, cursor: Option<&str>) -> Result<Self, Problem> {
        let limit = limit.unwrap_or(LIMIT_DEFAULT);
        if !(1..=LIMIT_MAX).contains(&limit) {
            let detail = format!("limit is {limit}; it must be from 1 to {LIMIT_MAX}");
            return Err(Problem::invalid_field("?limit", detail));
        }
        let before = match cursor {
            None => None,
            Some(text) => Some(Uuid::try_parse(text).map_err(|_| {
                Problem::invalid_field("?cursor", "cursor is not one that this service has given; begin without one")
            })?),
        };
        Ok(Self { before, limit })
    }

    /// One more than fits on the page: how many to fetch, to know whether there is a next page.
    #[must_use]
    pub fn fetch(&self) -> u32 {
        self.limit + 1
    }

    /// Makes the page out of what was fetched.
    pub fn page<S, T>(&self, fetched: Vec<S>, id: impl Fn(&S) -> Uuid, shown: impl Fn(S) -> T) -> Page<T> {
        let more = fetched.len() > self.limit as usize;
        let mut items = fetched;
        items.truncate(self.limit as usize);
        let next_cursor = items.last().filter(|_| more).map(|last| id(last).simple().to_string());
        Page { items: items.into_iter().map(shown).collect(), next_cursor }
    }
}
