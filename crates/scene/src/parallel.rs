//! Parallel loops, on the threads of the current pool of rayon.
//!
//! All run through [`run`], whose closure is a `dyn Fn`: rayon's adaptors compile the splitting of
//! the work anew for every loop. So a call must be worth a task: a row, a tile, a chunk. Loops over
//! small elements take a `grain`, the minimum number of them in a task. Results come in the order
//! of the input and do not depend on the number of threads.
#![allow(unsafe_code)]

use rayon::prelude::*;
use std::mem::MaybeUninit;
use std::ops::Range;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

/// The grain where an element costs little.
pub const GRAIN: usize = 1 << 12;
/// Tasks per thread where elements are cheap: enough that no thread waits long for the last one.
const TASKS_PER_THREAD: usize = 8;

/// Threads of the current pool.
pub fn threads() -> usize {
    rayon::current_num_threads()
}

/// Calls `task` with every number below `count`.
pub fn run(count: usize, task: &(dyn Fn(usize) + Sync)) {
    match count {
        0 | 1 => (0..count).for_each(task),
        _ => (0..count).into_par_iter().for_each(task),
    }
}

/// Calls `work` with every item and its number; each call is a task.
pub fn for_each<I: Send>(items: impl IntoIterator<Item = I>, work: impl Fn(usize, I) + Sync) {
    let items = Items::new(items);
    run(items.0.len(), &|i| work(i, items.take(i)));
}

/// [`for_each`] with a value that consecutive items share, such as scratch memory.
pub fn for_each_with<I: Send, S>(
    items: impl IntoIterator<Item = I>,
    init: impl Fn() -> S + Sync,
    work: impl Fn(&mut S, usize, I) + Sync,
) {
    map_with(items, init, work);
}

/// The results of `work` for every item and its number; each call is a task.
pub fn map<I: Send, T: Send>(
    items: impl IntoIterator<Item = I>,
    work: impl Fn(usize, I) -> T + Sync,
) -> Vec<T> {
    let items = Items::new(items);
    let mut out = Vec::with_capacity(items.0.len());
    fill(&mut out, items.0.len(), 1, || (), |(), i| work(i, items.take(i)));
    out
}

/// [`map`] with a value that consecutive items share, such as scratch memory.
pub fn map_with<I: Send, S, T: Send>(
    items: impl IntoIterator<Item = I>,
    init: impl Fn() -> S + Sync,
    work: impl Fn(&mut S, usize, I) -> T + Sync,
) -> Vec<T> {
    let items = Items::new(items);
    let count = items.0.len();
    let mut out = Vec::with_capacity(count);
    fill(&mut out, count, task_len(count, 1), init, |state, i| work(state, i, items.take(i)));
    out
}

/// The values of every number below `count`, at least `grain` of them in a task.
pub fn collect<T: Send>(count: usize, grain: usize, value: impl Fn(usize) -> T + Sync) -> Vec<T> {
    let mut out = Vec::with_capacity(count);
    extend(&mut out, count, grain, value);
    out
}

/// Appends the values of every number below `count` to `out`, at least `grain` of them in a task.
pub fn extend<T: Send>(
    out: &mut Vec<T>,
    count: usize,
    grain: usize,
    value: impl Fn(usize) -> T + Sync,
) {
    fill(out, count, task_len(count, grain), || (), |(), i| value(i));
}

/// The values of the numbers below `count` that have one, at least `grain` numbers in a task.
pub fn filter_map<T: Send>(
    count: usize,
    grain: usize,
    value: impl Fn(usize) -> Option<T> + Sync,
) -> Vec<T> {
    let parts = ranges(count, grain, |range| range.filter_map(&value).collect::<Vec<T>>());
    let mut out = Vec::with_capacity(parts.iter().map(Vec::len).sum());
    for part in parts {
        out.extend(part);
    }
    out
}

/// The value of the least number below `count` that has one, at least `grain` numbers in a task.
pub fn find_first<T: Send>(
    count: usize,
    grain: usize,
    value: impl Fn(usize) -> Option<T> + Sync,
) -> Option<T> {
    let first_range = AtomicUsize::new(usize::MAX);
    let firsts = ranges(count, grain, |range| {
        if first_range.load(Ordering::Relaxed) < range.start {
            return None;
        }
        let value = range.clone().find_map(&value);
        if value.is_some() {
            first_range.fetch_min(range.start, Ordering::Relaxed);
        }
        value
    });
    firsts.into_iter().flatten().next()
}

/// The results of `work` for consecutive ranges of the numbers below `count`, each of at least
/// `grain`, but the last. Their number depends on the number of threads, so combine them only by
/// operations that do not: sums of integers, joined lists.
pub fn ranges<T: Send>(
    count: usize,
    grain: usize,
    work: impl Fn(Range<usize>) -> T + Sync,
) -> Vec<T> {
    let len = task_len(count, grain);
    map((0..count).step_by(len), |_, from| work(from..(from + len).min(count)))
}

/// Calls `work` with the number of every value and the value, at least `grain` of them in a task.
pub fn for_each_mut<T: Send>(values: &mut [T], grain: usize, work: impl Fn(usize, &mut T) + Sync) {
    let len = task_len(values.len(), grain);
    for_each(values.chunks_mut(len), |task, values| {
        for (i, value) in (task * len..).zip(values) {
            work(i, value);
        }
    });
}

/// Elements of a task.
fn task_len(count: usize, grain: usize) -> usize {
    count.div_ceil(TASKS_PER_THREAD * threads()).max(grain).max(1)
}

/// Appends `count` values to `out`, `len` of them in a task.
fn fill<S, T: Send>(
    out: &mut Vec<T>,
    count: usize,
    len: usize,
    init: impl Fn() -> S + Sync,
    value: impl Fn(&mut S, usize) -> T + Sync,
) {
    out.reserve(count);
    let free: &mut [MaybeUninit<T>] = &mut out.spare_capacity_mut()[..count];
    for_each(free.chunks_mut(len), |task, slots| {
        let mut state = init();
        for (slot, i) in slots.iter_mut().zip(task * len..) {
            slot.write(value(&mut state, i));
        }
    });
    // SAFETY: `for_each` returns when every task has written its slots, which are the first `count`
    // behind the old end; a panic of a task leaves the length as it was.
    unsafe { out.set_len(out.len() + count) };
}

/// Items that tasks take.
struct Items<I>(Vec<Mutex<Option<I>>>);

impl<I> Items<I> {
    fn new(items: impl IntoIterator<Item = I>) -> Self {
        Self(items.into_iter().map(|item| Mutex::new(Some(item))).collect())
    }

    /// Item `i`, which only its own task asks for.
    fn take(&self, i: usize) -> I {
        let item = self.0[i].lock().unwrap_or_else(PoisonError::into_inner).take();
        item.unwrap_or_else(|| unreachable!("item {i} is taken twice"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The result of `work` on one thread, which must be that on three.
    fn on_any_threads<T: Send + PartialEq + std::fmt::Debug>(work: impl Fn() -> T + Sync) -> T {
        let on = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            pool.install(&work)
        };
        let one = on(1);
        assert_eq!(one, on(3));
        one
    }

    #[test]
    fn results_come_in_the_order_of_the_input() {
        for count in [0, 1, 2, 23, 24, 25, 1000] {
            let square = |i: usize| (i * i).to_string();
            let wanted: Vec<String> = (0..count).map(square).collect();
            assert_eq!(on_any_threads(|| collect(count, 1, square)), wanted);
            assert_eq!(on_any_threads(|| collect(count, 100, square)), wanted);
            assert_eq!(on_any_threads(|| map(0..count, |i, item| square((i + item) / 2))), wanted);
            let with = || map_with(0..count, String::new, |_, i, item| square((i + item) / 2));
            assert_eq!(on_any_threads(with), wanted);
            let mut longer = vec!["first".to_owned()];
            extend(&mut longer, count, 7, square);
            assert_eq!(longer[1..], wanted);
            let even = |i: usize| i.is_multiple_of(2).then_some(i);
            let wanted: Vec<usize> = (0..count).step_by(2).collect();
            assert_eq!(on_any_threads(|| filter_map(count, 3, even)), wanted);
        }
    }

    #[test]
    fn every_value_is_visited_once() {
        for count in [0, 1, 2, 25, 1000] {
            let doubled = || {
                let mut values: Vec<usize> = (0..count).collect();
                for_each_mut(&mut values, 4, |i, value| *value += i);
                let mut tripled = values.clone();
                for_each(tripled.chunks_mut(3).zip(values.chunks(3)), |task, (to, from)| {
                    to.iter_mut()
                        .zip(from)
                        .zip(3 * task..)
                        .for_each(|((to, from), i)| *to = from + i);
                });
                tripled
            };
            assert_eq!(on_any_threads(doubled), (0..count).map(|i| 3 * i).collect::<Vec<_>>());
            let sum = || ranges(count, 10, |range| range.sum::<usize>()).iter().sum::<usize>();
            assert_eq!(on_any_threads(sum), (0..count).sum::<usize>());
        }
    }

    #[test]
    fn the_first_that_is_found_is_the_least() {
        let multiple = |of: usize| move |i: usize| (i > 0 && i.is_multiple_of(of)).then_some(i);
        assert_eq!(on_any_threads(|| find_first(10_000, 1, multiple(37))), Some(37));
        assert_eq!(on_any_threads(|| find_first(10_000, 100, multiple(9999))), Some(9999));
        assert_eq!(on_any_threads(|| find_first(10_000, 100, multiple(10_000))), None);
    }

    #[test]
    fn a_panic_of_a_task_reaches_the_caller() {
        let caught = std::panic::catch_unwind(|| {
            collect(100, 1, |i| {
                assert!(i != 50, "the fiftieth");
                vec![i]
            })
        });
        let message = caught.unwrap_err();
        assert_eq!(message.downcast_ref::<&str>(), Some(&"the fiftieth"));
    }
}
