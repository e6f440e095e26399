use std::time::Duration;

use super::*;
use crate::store::blocks::{self, Block, BlockImage};
use crate::store::now;
use crate::store::references::tests::{Bench, finished};

impl Bench {
    async fn waiting(&self, lane: &str, priority: Priority) -> Uuid {
        let image_id = self.image().await;
        let (id, lane, prepared) = (Uuid::now_v7(), lane.to_owned(), "{}".to_owned());
        let new = NewOrientation { id, image_id, camera_id: self.camera_id, prepared, lane, priority, webhook: None };
        let mut transaction = self.store.begin_write().await.unwrap();
        insert(&mut transaction, &new).await.unwrap().unwrap();
        transaction.commit().await.unwrap();
        id
    }

    /// Those that wait, in the order of the queue.
    async fn order(&self) -> Vec<Uuid> {
        let mut transaction = self.store.begin_write().await.unwrap();
        let mut all = waiting(&mut transaction).await.unwrap();
        // ids are in the order in which they were asked for
        all.sort_by_key(|(id, turn)| (std::cmp::Reverse(i64::from(turn.priority)), turn.number, *id));
        all.into_iter().map(|(id, _)| id).collect()
    }

    async fn begun(&self, id: Uuid, worker: Uuid) -> Claim {
        let claim = Claim { id, lease: Uuid::now_v7() };
        self.store.begin_attempt(claim, worker).await.unwrap().unwrap();
        claim
    }

    async fn recovered(&self, abandoned: Abandoned) -> Vec<Uuid> {
        let mut transaction = self.store.begin_write().await.unwrap();
        let again = recover(&mut transaction, abandoned, "killed").await.unwrap();
        transaction.commit().await.unwrap();
        again.into_iter().map(|(id, _)| id).collect()
    }

    /// What is cancelled with a block of this orientation alone.
    async fn cancelled_with_block(&self, id: Uuid) -> Vec<Uuid> {
        let text = String::new;
        let block =
            Block { id: Uuid::now_v7(), name: text(), settings: text(), crs: text(), images: 1, created_at: now() };
        let image = BlockImage {
            number: 1,
            name: text(),
            approximation: text(),
            sha256: None,
            image_id: None,
            orientation_id: Some(id),
        };
        let mut transaction = self.store.begin_write().await.unwrap();
        blocks::insert(&mut transaction, &block).await.unwrap();
        blocks::insert_image(&mut transaction, block.id, &image).await.unwrap();
        let cancelled = blocks::cancel(&mut transaction, block.id).await.unwrap();
        transaction.commit().await.unwrap();
        cancelled
    }

    /// Lets a lease run out.
    async fn age(&self, id: Uuid) {
        let age = query("UPDATE orientations SET lease_until_ms = lease_until_ms - 30001 WHERE id = $1").bind(id);
        assert_eq!(age.execute(self.store.database()).await.unwrap(), 1);
    }
}

#[tokio::test]
async fn lanes_take_turns_however_long_one_of_them_is() {
    let bench = Bench::new().await;
    let mut block = Vec::new();
    for _ in 0..6 {
        block.push(bench.waiting("block", Priority::Normal).await);
    }
    let caller = bench.waiting("caller", Priority::Normal).await;
    let caller_again = bench.waiting("caller", Priority::Normal).await;
    let order = bench.order().await;
    assert_eq!(order[..4], [block[0], caller, block[1], caller_again]);
    assert_eq!(order[4..], block[2..]);
    // when some are under way, a new lane begins where the work is, not where it began
    for id in [block[0], caller, block[1], caller_again] {
        bench.begun(id, Uuid::nil()).await;
    }
    let late = bench.waiting("late", Priority::Normal).await;
    assert_eq!(bench.order().await[..3], [block[2], late, block[3]]);
}

#[tokio::test]
async fn priorities_go_before_turns() {
    let bench = Bench::new().await;
    let [low, normal, high] = [
        bench.waiting("a", Priority::Low).await,
        bench.waiting("a", Priority::Normal).await,
        bench.waiting("a", Priority::High).await,
    ];
    assert_eq!(bench.order().await, [high, normal, low]);
}

#[tokio::test]
async fn an_attempt_that_goes_on_keeps_its_lease_and_one_that_is_silent_loses_it() {
    let bench = Bench::new().await;
    let (silent, lively) = (bench.waiting("", Priority::Normal).await, bench.waiting("", Priority::Normal).await);
    let (silent_claim, lively_claim) = (bench.begun(silent, Uuid::nil()).await, bench.begun(lively, Uuid::nil()).await);
    assert!(!bench.store.any_late().await.unwrap());
    for id in [silent, lively] {
        bench.age(id).await;
    }
    assert!(bench.store.any_late().await.unwrap());
    assert!(bench.store.note_progress(lively_claim, "adjust", 0.5).await.unwrap());
    assert_eq!(bench.recovered(Abandoned::Late).await, [silent]);
    assert!(bench.store.holds(lively_claim).await.unwrap());
    assert!(!bench.store.holds(silent_claim).await.unwrap());
    assert!(!bench.store.note_progress(silent_claim, "adjust", 0.5).await.unwrap());
    let row = bench.store.orientation(silent).await.unwrap().unwrap();
    assert_eq!((row.status, row.attempts, row.fate.as_deref()), (Status::Queued, 1, Some("killed")));
}

/// J2: who was stopped for longer than his lease changes nothing when he goes on, whatever has happened meanwhile.
#[tokio::test]
async fn a_hundred_late_workers_write_nothing() {
    let bench = Bench::new().await;
    let mut rejected = 0;
    for round in 0..100 {
        let id = bench.waiting("", Priority::Normal).await;
        let late = bench.begun(id, Uuid::nil()).await;
        bench.age(id).await;
        assert_eq!(bench.recovered(Abandoned::Late).await, [id]);
        // it waits, is with another one, or has ended
        let now = (round % 3 > 0).then_some(bench.begun(id, Uuid::now_v7()));
        if let Some(now) = now {
            let now = now.await;
            if round % 3 == 2 {
                assert!(bench.store.finish(now, &finished("2", &[])).await.unwrap());
            }
        }
        let before = bench.store.orientation(id).await.unwrap();
        let written = bench.store.finish(late, &finished("late", &[])).await.unwrap();
        let failed = bench.store.fail(late, &Failure { code: "late".into(), detail: "late".into() }).await.unwrap();
        assert_eq!(bench.store.orientation(id).await.unwrap(), before);
        rejected += u32::from(!written && !failed);
    }
    assert_eq!(rejected, 100);
}

#[tokio::test]
async fn what_a_process_had_under_way_is_found_by_its_name() {
    let bench = Bench::new().await;
    let (dead, other) = (Uuid::now_v7(), Uuid::now_v7());
    let (of_dead, of_other) = (bench.waiting("", Priority::Normal).await, bench.waiting("", Priority::Normal).await);
    bench.begun(of_dead, dead).await;
    bench.begun(of_other, other).await;
    assert_eq!(bench.recovered(Abandoned::By(dead)).await, [of_dead]);
    assert_eq!(bench.recovered(Abandoned::By(dead)).await, Vec::<Uuid>::new());
    assert_eq!(bench.store.queued().await.unwrap(), 1);
    assert!(bench.store.oldest_wait().await.unwrap().unwrap() < Duration::from_secs(60));
}

/// Who was to be told of an orientation has an event when it has ended, made in the same transaction, and one only.
#[tokio::test]
async fn every_end_is_an_event_for_who_asked_to_be_told() {
    let bench = Bench::new().await;
    let told = |id| query("UPDATE orientations SET webhook = 'https://example.org/' WHERE id = $1").bind(id);
    let mut ended = Vec::new();
    for end in ["finish", "fail", "cancel", "block", "late"] {
        let id = bench.waiting("a", Priority::Normal).await;
        told(id).execute(bench.store.database()).await.unwrap();
        let claim = bench.begun(id, Uuid::now_v7()).await;
        let other = Claim { lease: Uuid::now_v7(), ..claim };
        match end {
            "finish" => assert!(bench.store.finish(claim, &finished("{}", &[])).await.unwrap()),
            "fail" => {
                let failure = Failure { code: "broken".into(), detail: "it is broken".into() };
                assert!(bench.store.fail(claim, &failure).await.unwrap());
            }
            "cancel" => assert!(bench.store.cancel(id).await.unwrap()),
            "block" => assert_eq!(bench.cancelled_with_block(id).await, [id]),
            _ => assert!(!bench.store.finish(other, &finished("{}", &[])).await.unwrap()),
        }
        assert!(end == "late" || !bench.store.cancel(id).await.unwrap());
        ended.push(id);
    }
    ended.pop();
    let untold = bench.waiting("a", Priority::Normal).await;
    assert!(bench.store.cancel(untold).await.unwrap());
    let events = bench.store.webhooks(None, None, 10).await.unwrap();
    assert_eq!(events.iter().rev().map(|event| event.orientation_id).collect::<Vec<_>>(), ended);
}
