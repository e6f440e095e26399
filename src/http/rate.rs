//! How often one caller may ask, and how many requests are answered at a time.
//!
//! Every caller has a bucket of tokens; a request takes one, and they come back at a steady rate. A bucket that is full
//! is not kept.

use std::collections::HashMap;
use std::net::IpAddr;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use axum::extract::{MatchedPath, Request, State};
use axum::middleware::Next;
use axum::response::{IntoResponse as _, Response};
use tokio::sync::Semaphore;

use super::problem::Problem;

/// Callers of whom is known that they have asked lately; those above it share one bucket.
const CALLERS_MAX: usize = 20_000;

/// Whom all those share a bucket with who are too many.
const OTHERS: &str = "others";

/// Where a request comes from: put into each by the loop that accepts connections.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ClientAddress(pub IpAddr);

impl ClientAddress {
    /// Who shares its bucket. Of IPv6, each household has 2^64 addresses.
    #[must_use]
    pub fn caller(self) -> String {
        match self.0.to_canonical() {
            IpAddr::V4(address) => address.to_string(),
            IpAddr::V6(address) => {
                let [a, b, c, d, ..] = address.segments();
                format!("{a:x}:{b:x}:{c:x}:{d:x}::/64")
            }
        }
    }
}

/// A bucket for each caller. Cheap to clone; all clones are the same.
#[derive(Debug, Clone)]
pub struct Rates {
    per_s: f64,
    burst: f64,
    buckets: Arc<Mutex<HashMap<String, Bucket>>>,
}

#[derive(Debug, Clone, Copy)]
struct Bucket {
    tokens: f64,
    at: Instant,
}

impl Rates {
    /// Buckets of `burst` tokens into which `per_s` come a second; with 0 there is no limit.
    #[must_use]
    pub fn new(per_s: f64, burst: f64) -> Self {
        Self { per_s, burst, buckets: Arc::default() }
    }

    /// Takes a token of this caller's.
    ///
    /// # Errors
    /// How long until there is one.
    pub fn take(&self, caller: &str) -> Result<(), Duration> {
        self.take_at(caller, Instant::now())
    }

    fn take_at(&self, caller: &str, now: Instant) -> Result<(), Duration> {
        if self.per_s == 0.0 {
            return Ok(());
        }
        let mut buckets = self.buckets.lock().unwrap_or_else(PoisonError::into_inner);
        if buckets.len() >= CALLERS_MAX && !buckets.contains_key(caller) {
            buckets.retain(|_, bucket| self.tokens(*bucket, now) < self.burst);
        }
        let full = buckets.len() >= CALLERS_MAX && !buckets.contains_key(caller);
        let fresh = Bucket { tokens: self.burst, at: now };
        let bucket = buckets.entry(if full { OTHERS } else { caller }.to_owned()).or_insert(fresh);
        *bucket = Bucket { tokens: self.tokens(*bucket, now), at: now };
        if bucket.tokens < 1.0 {
            return Err(Duration::from_secs_f64((1.0 - bucket.tokens) / self.per_s));
        }
        bucket.tokens -= 1.0;
        Ok(())
    }

    /// Gives a token back that was not used after all.
    pub fn give_back(&self, caller: &str) {
        let mut buckets = self.buckets.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(bucket) = buckets.get_mut(caller) {
            bucket.tokens += 1.0;
        }
    }

    fn tokens(&self, bucket: Bucket, now: Instant) -> f64 {
        (bucket.tokens + now.saturating_duration_since(bucket.at).as_secs_f64() * self.per_s).min(self.burst)
    }
}

/// 429, with when to come back.
#[must_use]
pub fn refused(detail: &str, wait: Duration) -> Problem {
    let seconds = wait.as_secs_f64().ceil().clamp(1.0, 3600.0);
    Problem::too_many(detail).with_retry_after(seconds as u32)
}

/// Answers at once what is too much at a time. Health and metrics are always answered: they tell of it.
pub async fn shed(State(slots): State<Arc<Semaphore>>, request: Request, next: Next) -> Response {
    let route = request.extensions().get::<MatchedPath>().map_or("", MatchedPath::as_str);
    if route.starts_with("/health/") || route == "/metrics" {
        return next.run(request).await;
    }
    let Ok(_slot) = slots.try_acquire() else {
        return Problem::unavailable("Too many requests are being answered.", 1).into_response();
    };
    next.run(request).await
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn burst_is_let_through_and_then_the_rate() {
        let (rates, began) = (Rates::new(2.0, 5.0), Instant::now());
        assert!((0..5).all(|_| rates.take_at("a", began).is_ok()));
        assert_eq!(rates.take_at("a", began), Err(Duration::from_millis(500)));
        rates.take_at("b", began).unwrap();
        let later = began + Duration::from_millis(500);
        rates.take_at("a", later).unwrap();
        assert!(rates.take_at("a", later).is_err());
        rates.give_back("a");
        rates.take_at("a", later).unwrap();
        let much_later = began + Duration::from_secs(3600);
        assert!((0..5).all(|_| rates.take_at("a", much_later).is_ok()));
        assert!(rates.take_at("a", much_later).is_err());
        assert!((0..1000).all(|_| Rates::new(0.0, 1.0).take("a").is_ok()));
    }

    #[test]
    fn callers_without_end_take_no_memory_without_end() {
        let (rates, began) = (Rates::new(1.0, 2.0), Instant::now());
        for caller in 0..3 * CALLERS_MAX {
            let _ = rates.take_at(&caller.to_string(), began);
        }
        assert!(rates.buckets.lock().unwrap().len() <= CALLERS_MAX + 1);
        let later = began + Duration::from_secs(2);
        rates.take_at("new", later).unwrap();
        assert_eq!(rates.buckets.lock().unwrap().len(), 1);
    }

    #[test]
    fn addresses_of_one_household_are_one_caller() {
        let caller = |text: &str| ClientAddress(text.parse().unwrap()).caller();
        assert_eq!(caller("2001:db8:1:2::3"), caller("2001:db8:1:2:ffff::4"));
        assert_ne!(caller("2001:db8:1:2::3"), caller("2001:db8:1:3::3"));
        assert_eq!(caller("::ffff:192.0.2.1"), "192.0.2.1");
    }
}
