//! Independent runs on all cores, with a progress bar, and results in the order of the runs.

use indicatif::{ProgressBar, ProgressStyle};
use miette::Result;
use std::num::NonZeroUsize;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc;

/// Calls `one` for every item on `jobs` threads, as many as there are cores by default, and `each` with
/// an item's index and result on this thread, in the order in which they end.
///
/// # Errors
/// The first error of `one` or `each`; what runs then is finished, nothing more is begun.
pub(crate) fn run<I: Sync, T: Send>(
    items: &[I],
    jobs: Option<NonZeroUsize>,
    one: impl Fn(&I) -> Result<T> + Sync,
    mut each: impl FnMut(usize, T) -> Result<()>,
) -> Result<()> {
    let jobs = jobs.or_else(|| std::thread::available_parallelism().ok()).map_or(1, NonZeroUsize::get);
    let bar = ProgressBar::new(items.len() as u64).with_style(
        ProgressStyle::with_template("{bar:30} {pos}/{len} runs  {elapsed}")
            .unwrap_or_else(|_| ProgressStyle::default_bar()),
    );
    let next = AtomicUsize::new(0);
    let (sender, results) = mpsc::channel();
    let done = std::thread::scope(|scope| {
        for _ in 0..jobs.min(items.len()) {
            let (sender, next, one) = (sender.clone(), &next, &one);
            scope.spawn(move || {
                loop {
                    let k = next.fetch_add(1, Ordering::Relaxed);
                    let Some(item) = items.get(k) else { break };
                    if sender.send((k, one(item))).is_err() {
                        break;
                    }
                }
            });
        }
        drop(sender);
        let mut done = Ok(());
        for (k, result) in results {
            done = result.and_then(|result| each(k, result));
            if done.is_err() {
                next.store(items.len(), Ordering::Relaxed);
                break;
            }
            bar.inc(1);
        }
        done
    });
    bar.finish_and_clear();
    done
}

#[cfg(test)]
mod tests {
    use super::run;
    use miette::miette;
    use std::num::NonZeroUsize;

    #[test]
    fn every_item_is_run_once_and_an_error_ends_it() {
        let items: Vec<u32> = (0..100).collect();
        let mut seen = vec![0; 100];
        let jobs = NonZeroUsize::new(4);
        let note = |k: usize, square: u32| {
            seen[k] = square;
            Ok(())
        };
        run(&items, jobs, |k| Ok(k * k), note).unwrap();
        assert!(seen.iter().zip(&items).all(|(square, k)| *square == k * k));

        let failed =
            run(&items, jobs, |k| if *k == 7 { Err(miette!("seven")) } else { Ok(()) }, |_, ()| Ok(()));
        assert_eq!(failed.unwrap_err().to_string(), "seven");
    }
}
