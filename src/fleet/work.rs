//! Works a list off: every job its row, whatever happens to it.

use std::collections::HashMap;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, OnceLock};

use serde_json::Value;

use super::FleetError;
use super::list::{Job, ModelSource};
use super::row::{Row, Status};
use super::store::Store;
use crate::digest;

/// What a worker is asked to do.
pub trait Task: Sync {
    /// A model, ready for use.
    type Model: Send + Sync;

    /// `diagnose` or `identify`.
    fn name(&self) -> &'static str;

    /// Whether jobs need a model.
    fn needs_model(&self) -> bool;

    /// A model from its source.
    ///
    /// # Errors
    /// The words for the row.
    fn model(&self, source: &ModelSource) -> Result<Self::Model, String>;

    /// The answer to a job: files by their extensions, of which `json` is the document.
    ///
    /// # Errors
    /// The words for the row.
    fn answer(&self, job: &Job, model: Option<&Self::Model>) -> Result<Vec<(&'static str, String)>, String>;
}

/// How far the work is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Progress {
    /// Jobs in this part.
    pub jobs: usize,
    /// Answered now.
    pub done: usize,
    /// Answered before: recording, model and version agree.
    pub skipped: usize,
    /// With a row that says why there is no answer.
    pub unusable: usize,
}

#[derive(Default)]
struct Counters {
    next: AtomicUsize,
    done: AtomicUsize,
    skipped: AtomicUsize,
    unusable: AtomicUsize,
}

impl Counters {
    fn progress(&self, jobs: usize) -> Progress {
        let now = |c: &AtomicUsize| c.load(Ordering::Relaxed);
        Progress { jobs, done: now(&self.done), skipped: now(&self.skipped), unusable: now(&self.unusable) }
    }
}

/// A model and the digest of what it is made from; made once for all jobs that share it.
struct Shared<M> {
    digest: OnceLock<Result<String, String>>,
    model: OnceLock<Result<M, String>>,
}

impl<M> Default for Shared<M> {
    fn default() -> Self {
        Self { digest: OnceLock::new(), model: OnceLock::new() }
    }
}

/// The digests of files that hold many recordings.
type Files = Mutex<HashMap<PathBuf, Arc<OnceLock<Result<String, String>>>>>;

/// Works all jobs off with `threads` workers, each a job at a time, so that memory is bounded by the largest recordings.
/// `stop` ends it after the jobs in hand; `told` hears of each job.
///
/// # Errors
/// [`FleetError::Store`] where rows cannot be written. What is wrong with a job is in its row.
pub fn work<T: Task>(
    task: &T,
    jobs: &[Job],
    store: &Store,
    threads: usize,
    stop: &AtomicBool,
    told: &(dyn Fn(Progress) + Sync),
) -> Result<Progress, FleetError> {
    let counters = Counters::default();
    let models: Mutex<HashMap<ModelSource, Arc<Shared<T::Model>>>> = Mutex::new(HashMap::new());
    let files = Files::default();
    let failed: Mutex<Option<FleetError>> = Mutex::new(None);
    let workers = threads.clamp(1, jobs.len().max(1));
    let worker = || {
        while let Some(job) = jobs.get(counters.next.fetch_add(1, Ordering::Relaxed)) {
            if stop.load(Ordering::Relaxed) || lock(&failed).is_some() {
                break;
            }
            let shared = Arc::clone(lock(&models).entry(job.model.clone()).or_default());
            if let Err(error) = one(task, job, store, (&shared, &files), &counters) {
                lock(&failed).get_or_insert(error);
            }
            told(counters.progress(jobs.len()));
        }
    };
    std::thread::scope(|scope| {
        for _ in 0..workers {
            scope.spawn(|| {
                // a worker's own pool: nobody's job waits inside another's
                match rayon::ThreadPoolBuilder::new().num_threads((threads / workers).max(1)).build() {
                    Ok(pool) => pool.install(worker),
                    Err(_) => worker(),
                }
            });
        }
    });
    match failed.into_inner().unwrap_or_else(std::sync::PoisonError::into_inner) {
        Some(error) => Err(error),
        None => Ok(counters.progress(jobs.len())),
    }
}

fn lock<V>(mutex: &Mutex<V>) -> std::sync::MutexGuard<'_, V> {
    mutex.lock().unwrap_or_else(std::sync::PoisonError::into_inner)
}

fn one<T: Task>(
    task: &T,
    job: &Job,
    store: &Store,
    (shared, files): (&Shared<T::Model>, &Files),
    counters: &Counters,
) -> Result<(), FleetError> {
    let mut row = blank(task, job, store.attempt(&job.id));
    let asked = digests(task, job, shared, files, &mut row);
    if store.has(&row) {
        counters.skipped.fetch_add(1, Ordering::Relaxed);
        return Ok(());
    }
    match asked.and_then(|()| guarded(|| answer(task, job, shared))) {
        Ok(files) => {
            row.status = Status::Done;
            let document = files.iter().find(|f| f.0 == "json").and_then(|f| serde_json::from_str(&f.1).ok());
            row.fill(&document.unwrap_or(Value::Null));
            let files: Vec<(&str, &str)> = files.iter().map(|(e, t)| (*e, t.as_str())).collect();
            store.keep(row, &files)?;
            counters.done.fetch_add(1, Ordering::Relaxed);
        }
        Err(words) => {
            row.error = Some(words);
            store.keep(row, &[])?;
            counters.unusable.fetch_add(1, Ordering::Relaxed);
        }
    }
    Ok(())
}

fn blank<T: Task>(task: &T, job: &Job, attempt: u32) -> Row {
    Row {
        id: job.id.clone(),
        task: task.name().to_owned(),
        attempt,
        status: Status::Unusable,
        error: None,
        recording: job.recording.display().to_string()
            + &job.group.as_ref().map(|g| format!("#{}={}", g.column, g.value)).unwrap_or_default(),
        recording_sha256: None,
        model: if task.needs_model() { job.model.text() } else { String::new() },
        model_sha256: None,
        version: env!("CARGO_PKG_VERSION").to_owned(),
        verdict: None,
        effects: Vec::new(),
        form: Vec::new(),
        recalibration: std::collections::BTreeMap::new(),
        rmse_bar: std::collections::BTreeMap::new(),
        remainder: None,
        document: None,
        tags: job.tags.clone(),
    }
}

/// What the answer will depend on.
fn digests<T: Task>(task: &T, job: &Job, shared: &Shared<T::Model>, files: &Files, row: &mut Row) -> Result<(), String> {
    let digest = |path: &PathBuf| digest::sha256_of_file(path).map_err(|e| format!("{}: {e}", path.display()));
    row.recording_sha256 = Some(match &job.group {
        None => digest(&job.recording)?,
        // One file stands for many jobs; it is read for its digest once.
        Some(group) => {
            let whole = lock(files).entry(job.recording.clone()).or_default().clone();
            let whole = whole.get_or_init(|| digest(&job.recording)).clone()?;
            digest::sha256(format!("{whole} {} {}", group.column, group.value))
        }
    });
    if task.needs_model() {
        let made_from = || match &job.model {
            ModelSource::File(path) | ModelSource::Identify(path) => digest(path),
            ModelSource::Missing(why) => Err(why.clone()),
        };
        row.model_sha256 = Some(shared.digest.get_or_init(made_from).clone()?);
    }
    Ok(())
}

fn answer<T: Task>(task: &T, job: &Job, shared: &Shared<T::Model>) -> Result<Vec<(&'static str, String)>, String> {
    if !task.needs_model() {
        return task.answer(job, None);
    }
    match shared.model.get_or_init(|| guarded(|| task.model(&job.model))) {
        Ok(model) => task.answer(job, Some(model)),
        Err(words) => Err(words.clone()),
    }
}

/// A bug in one job is that job's row and not the end of ten thousand.
fn guarded<V>(work: impl FnOnce() -> Result<V, String>) -> Result<V, String> {
    let result = std::panic::catch_unwind(std::panic::AssertUnwindSafe(work));
    result.unwrap_or_else(|_| Err("internal error: this is a bug in hil; please report it with this recording and its model".to_owned()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::AtomicU32;

    /// Answers with the length of the recording; `boom` panics; counts the models that it made.
    #[derive(Default)]
    struct Length {
        models: AtomicU32,
    }

    impl Task for Length {
        type Model = usize;
        fn name(&self) -> &'static str {
            "diagnose"
        }
        fn needs_model(&self) -> bool {
            true
        }
        fn model(&self, source: &ModelSource) -> Result<usize, String> {
            self.models.fetch_add(1, Ordering::Relaxed);
            let (ModelSource::File(path) | ModelSource::Identify(path)) = source else { return Err("none".into()) };
            std::fs::read(path).map(|b| b.len()).map_err(|e| e.to_string())
        }
        fn answer(&self, job: &Job, model: Option<&usize>) -> Result<Vec<(&'static str, String)>, String> {
            let text = std::fs::read_to_string(&job.recording).map_err(|e| e.to_string())?;
            match text.as_str() {
                "boom" => std::panic::resume_unwind(Box::new("on purpose")),
                "bad" => Err("row 3: no number".into()),
                _ => Ok(vec![(
                    "json",
                    format!("{{\"verdict\":\"match\",\"rmse_bar\":{{\"base\":{}}}}}", text.len() + model.copied().unwrap_or(0)),
                )]),
            }
        }
    }

    fn jobs(folder: &std::path::Path, contents: &[&str]) -> std::io::Result<Vec<Job>> {
        std::fs::write(folder.join("m.toml"), "12345")?;
        contents
            .iter()
            .enumerate()
            .map(|(k, text)| {
                let recording = folder.join(format!("{k}.csv"));
                if !text.is_empty() {
                    std::fs::write(&recording, text)?;
                }
                Ok(Job {
                    id: k.to_string(),
                    recording,
                    model: ModelSource::File(folder.join("m.toml")),
                    tags: Default::default(),
                    group: None,
                })
            })
            .collect()
    }

    #[test]
    fn a_bad_recording_is_a_row_and_what_is_done_is_not_done_again() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let jobs = jobs(folder.path(), &["abc", "bad", "boom", "", "de"])?;
        let (task, stop) = (Length::default(), AtomicBool::new(false));
        let run = |name: &str, jobs: &[Job]| work(&task, jobs, &Store::open(folder.path(), name)?, 3, &stop, &|_| {});
        assert_eq!(run("a", &jobs)?, Progress { jobs: 5, done: 2, skipped: 0, unusable: 3 });
        assert_eq!(task.models.load(Ordering::Relaxed), 1, "one model serves all");
        // the recording that was not there is asked for again; nothing else is
        std::fs::write(&jobs[3].recording, "xyz")?;
        assert_eq!(run("b", &jobs)?, Progress { jobs: 5, done: 1, skipped: 4, unusable: 0 });
        let rows = super::super::collected::last_rows([folder.path()])?;
        assert_eq!(rows.iter().map(|r| r.attempt).collect::<Vec<_>>(), [1, 1, 1, 2, 1]);
        assert!(rows[1].error.as_deref() == Some("row 3: no number") && rows[0].rmse_bar["base"] == 8.0);
        // another model is another question
        std::fs::write(folder.path().join("m.toml"), "1")?;
        assert_eq!(run("c", &jobs[..1])?.done, 1);
        Ok(())
    }

    #[test]
    fn a_stop_ends_after_the_jobs_in_hand() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let jobs = jobs(folder.path(), &["a"; 50])?;
        let stop = AtomicBool::new(false);
        let told = |p: Progress| stop.store(p.done >= 3, Ordering::Relaxed);
        let progress = work(&Length::default(), &jobs, &Store::open(folder.path(), "a")?, 1, &stop, &told)?;
        assert_eq!(progress.done, 3);
        Ok(())
    }
}
