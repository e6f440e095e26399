//! Many orientations at once: accepted in one transaction, cancelled in one.

use uuid::Uuid;

use super::feed::{Change, Told};
use super::{Jobs, SubmitError};
use crate::database::Transaction;
use crate::store::StoreError;
use crate::store::blocks;
use crate::store::orientations::{self, NewOrientation, Status};

/// So many of the orientations that are accepted at once are told to other services.
const TOLD_OTHERS_MAX: usize = 100;

impl Jobs {
    /// Accepts orientations, all or none, as a part of a transaction that has begun alone: how many are new. Once that is
    /// complete, [`Self::announce`] says so.
    ///
    /// # Errors
    /// [`SubmitError`]; then the transaction is not to be completed.
    pub async fn submit_all(
        &self,
        transaction: &mut Transaction,
        new: &[NewOrientation],
    ) -> Result<usize, SubmitError> {
        let waiting = orientations::queued(&mut *transaction).await? as usize;
        let queue_max = self.0.settings.queue_max;
        let mut accepted = 0;
        for new in new {
            if let Some(turn) = orientations::insert(transaction, new).await? {
                accepted += 1;
                if waiting + accepted > queue_max as usize {
                    return Err(SubmitError::QueueFull { queue_max });
                }
                self.0.queue.push(transaction, new.id, turn).await?;
            }
        }
        self.0.gauge_queue(waiting + accepted);
        Ok(accepted)
    }

    /// Says that these are in the queue, after a transaction with [`Self::submit_all`].
    pub async fn announce(&self, new: &[NewOrientation]) {
        let changes: Vec<Change> = new.iter().map(|new| Change::to(new.id, Status::Queued)).collect();
        // before anybody begins with one of them
        for change in &changes {
            self.0.teller.tell(Told::Change(change.clone()));
        }
        // each is a statement; of the rest of a large block other services hear when it begins
        for change in changes.iter().take(TOLD_OTHERS_MAX) {
            self.0.tell_others(change).await;
        }
        self.0.call_workers().await;
    }

    /// Removes a block, and cancels its orientations that have not ended; `false` if there is none.
    ///
    /// # Errors
    /// [`StoreError`].
    pub async fn remove_block(&self, block: Uuid) -> Result<bool, StoreError> {
        let mut transaction = self.0.store.begin_write().await?;
        let cancelled = blocks::cancel(&mut transaction, block).await?;
        let removed = blocks::remove(&mut transaction, block).await?;
        transaction.commit().await?;
        for id in cancelled {
            if let Some(signal) = self.0.running().get(&id) {
                signal.interrupt();
            }
            self.0.ended(id, Status::Cancelled, None).await;
        }
        Ok(removed)
    }
}
