//! What was read a moment ago, so that it need not be read again at once.

use std::borrow::Borrow;
use std::collections::HashMap;
use std::hash::Hash;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Values that may be as old as what is promised: a key that another process revokes is refused within a second.
const AGE_MAX: Duration = Duration::from_millis(500);
/// So many values are kept at the most.
const VALUES_MAX: usize = 500;

/// Values that were read a moment ago. Whoever changes one in this process forgets it here.
#[derive(Debug)]
pub struct Recent<K, V>(Mutex<HashMap<K, (Instant, V)>>);

impl<K, V> Default for Recent<K, V> {
    fn default() -> Self {
        Self(Mutex::default())
    }
}

impl<K: Eq + Hash, V: Clone> Recent<K, V> {
    /// The value, if it was read a moment ago.
    pub fn get<Q: Eq + Hash + ?Sized>(&self, key: &Q) -> Option<V>
    where
        K: Borrow<Q>,
    {
        self.values().get(key).filter(|(at, _)| at.elapsed() < AGE_MAX).map(|(_, value)| value.clone())
    }

    /// Keeps a value that was just read: `read_at` is from before.
    pub fn put(&self, key: K, value: V, read_at: Instant) {
        let mut values = self.values();
        if values.len() >= VALUES_MAX {
            values.retain(|_, (at, _)| at.elapsed() < AGE_MAX);
        }
        if values.len() < VALUES_MAX {
            values.insert(key, (read_at, value));
        }
    }

    /// Forgets all values.
    pub fn forget_all(&self) {
        self.values().clear();
    }

    fn values(&self) -> MutexGuard<'_, HashMap<K, (Instant, V)>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_kept_for_a_moment_and_not_without_end() {
        let recent = Recent::default();
        let now = Instant::now();
        recent.put("a", 1, now);
        assert_eq!(recent.get("a"), Some(1));
        recent.put("b", 2, now.checked_sub(AGE_MAX).unwrap());
        assert_eq!(recent.get("b"), None);
        recent.forget_all();
        assert_eq!(recent.get("a"), None);
        let many = Recent::default();
        for key in 0..2 * VALUES_MAX {
            many.put(key, (), now);
        }
        assert!(many.values().len() <= VALUES_MAX);
    }
}
