//! The threads that the kernel runs on.

use std::process;
use std::ptr;
use std::sync::atomic::{AtomicPtr, Ordering};

use pyo3::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};

struct Pool {
    /// A forked child has a copy of the pool but none of its threads, and would wait for them for ever.
    process: u32,
    threads: ThreadPool,
}

static POOL: AtomicPtr<Pool> = AtomicPtr::new(ptr::null_mut());

/// Runs `work` on the threads of this process, without the lock of the interpreter.
pub fn run<T: Send>(py: Python<'_>, work: impl FnOnce() -> T + Send) -> T {
    py.detach(|| threads().install(work))
}

/// As [`run`], but where it is if `size` is not above `least`: the work is then one piece, and threads only cost time.
pub fn run_if_above<T: Send>(
    least: usize,
    size: usize,
    py: Python<'_>,
    work: impl FnOnce() -> T + Send,
) -> T {
    if size > least { run(py, work) } else { py.detach(work) }
}

/// Threads that [`run`] works on.
pub fn n_threads() -> usize {
    threads().current_num_threads()
}

/// The pool of this process, made when it is first asked for and kept to the end.
///
/// No lock: a fork may happen while another thread holds one.
fn threads() -> &'static ThreadPool {
    let found = POOL.load(Ordering::Acquire);
    // SAFETY: what POOL points to is never freed
    if let Some(pool) = unsafe { found.as_ref() }
        && pool.process == process::id()
    {
        return &pool.threads;
    }
    let threads = ThreadPoolBuilder::new().build().expect("the system gives no threads");
    let made = Box::into_raw(Box::new(Pool { process: process::id(), threads }));
    match POOL.compare_exchange(found, made, Ordering::AcqRel, Ordering::Acquire) {
        // SAFETY: as above
        Ok(_) => unsafe { &(*made).threads },
        Err(_) => {
            // SAFETY: no other thread has seen it
            drop(unsafe { Box::from_raw(made) });
            self::threads()
        }
    }
}
