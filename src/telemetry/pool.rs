use std::sync::atomic::{AtomicU64, Ordering};

use crossbeam::queue::ArrayQueue;

/// Records that travel in a circle: empty ones to the writers, full ones to the reader.
#[derive(Debug)]
pub struct Pool<T> {
    empty: ArrayQueue<Box<T>>,
    full: ArrayQueue<Box<T>>,
    lost: AtomicU64,
}

impl<T> Pool<T> {
    /// A pool of `records` records, all made now.
    pub fn new(records: usize, mut make: impl FnMut() -> T) -> Self {
        let records = records.max(1);
        let empty = ArrayQueue::new(records);
        for _ in 0..records {
            // Both queues hold every record there is, so that no push can fail.
            let _ = empty.push(Box::new(make()));
        }
        Self { empty, full: ArrayQueue::new(records), lost: AtomicU64::new(0) }
    }

    /// Fills an empty record and passes it on; `false` when none is left, which is counted.
    pub fn write(&self, fill: impl FnOnce(&mut T)) -> bool {
        let Some(mut record) = self.empty.pop() else {
            self.lost.fetch_add(1, Ordering::Relaxed);
            return false;
        };
        fill(&mut record);
        self.full.push(record).is_ok()
    }

    /// Shows the oldest full record to `read` and makes it empty again; `None` when there is none.
    pub fn read<R>(&self, read: impl FnOnce(&mut T) -> R) -> Option<R> {
        let mut record = self.take()?;
        let result = read(&mut record);
        self.give_back(record);
        Some(result)
    }

    /// The oldest full record, for whoever needs it longer; `None` when there is none.
    pub fn take(&self) -> Option<Box<T>> {
        self.full.pop()
    }

    /// Makes a record empty again that was [taken](Self::take) from this pool.
    pub fn give_back(&self, record: Box<T>) {
        let _ = self.empty.push(record);
    }

    /// Records that were not written because none was empty.
    pub fn lost(&self) -> u64 {
        self.lost.load(Ordering::Relaxed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn records_come_out_in_order_and_losses_are_counted() {
        let pool = Pool::new(2, || 0);
        assert!(pool.write(|r| *r = 1));
        assert!(pool.write(|r| *r = 2));
        assert!(!pool.write(|r| *r = 3));
        assert_eq!((pool.read(|r| *r), pool.lost()), (Some(1), 1));
        assert!(pool.write(|r| *r = 4));
        let held = pool.take().unwrap();
        assert_eq!((*held, pool.read(|r| *r), pool.take()), (2, Some(4), None));
        // One is still away.
        assert!(pool.write(|r| *r = 5) && !pool.write(|r| *r = 6));
        pool.give_back(held);
        assert!(pool.write(|r| *r = 7));
        assert_eq!([pool.read(|r| *r), pool.read(|r| *r), pool.read(|r| *r)], [Some(5), Some(7), None]);
    }

    #[test]
    fn writers_in_many_threads() {
        let pool = Pool::new(64, || (0, 0));
        std::thread::scope(|scope| {
            for writer in 0..4_u64 {
                let pool = &pool;
                scope.spawn(move || {
                    let mut sent = 0;
                    while sent < 1000 {
                        sent += u64::from(pool.write(|r| *r = (writer, sent)));
                    }
                });
            }
            let mut next = [0; 4];
            while next != [1000; 4] {
                let _ = pool.read(|&mut (writer, n)| {
                    let expected = &mut next[usize::try_from(writer).unwrap()];
                    assert_eq!(n, *expected);
                    *expected += 1;
                });
            }
        });
    }
}
