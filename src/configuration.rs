//! The settings of the service: a TOML file, overruled by `GABLE_*` in the environment, overruled by flags.
//!
//! The names are the same everywhere: `upload_max_bytes = 1000000` in the file is `GABLE_UPLOAD_MAX_BYTES=1000000` in
//! the environment. Each has its unit in its name.

mod callers;

use std::collections::HashMap;
use std::net::SocketAddr;
use std::path::{Path, PathBuf};
use std::time::Duration;

use serde::{Deserialize, Serialize};
use utoipa::openapi::{RefOr, Schema};
use utoipa::{PartialSchema as _, ToSchema};

use crate::diagnosis::Policy;
use crate::imagery::Limits;
use crate::learning::Costs;
use crate::store::Place;

/// How the log is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "lowercase")]
pub enum LogFormat {
    /// For people.
    Text,
    /// One JSON object a line, for log collectors.
    Json,
}

/// All settings. Durations are in seconds.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(deny_unknown_fields, default)]
#[non_exhaustive]
pub struct Configuration {
    /// Address and port that the service listens on.
    #[schema(value_type = String)]
    pub listen: SocketAddr,
    /// The data folder: database and pictures.
    #[schema(value_type = String)]
    pub data: PathBuf,
    /// The folder with geoid grids for compound CRSs, GeoTIFF as https://cdn.proj.org/ has them, or GTX; if it is not
    /// given, `geoids` in the data folder.
    #[schema(value_type = Option<String>)]
    pub geoid_folder: Option<PathBuf>,
    /// A PostgreSQL server, as in `postgres://user@host/gable`, in place of SQLite in the data folder.
    pub database_url: Option<String>,
    /// A bucket for the images, as in `s3://bucket/prefix`, in place of the data folder. Address, region and keys come from
    /// `AWS_ENDPOINT_URL`, `AWS_REGION`, `AWS_ACCESS_KEY_ID` and `AWS_SECRET_ACCESS_KEY`.
    pub objects_url: Option<String>,
    /// What is logged, as in `info,gable=debug`.
    pub log: String,
    /// How it is logged: `text` or `json`.
    #[schema(value_type = String)]
    pub log_format: LogFormat,
    /// The largest image that may be uploaded.
    pub upload_max_bytes: u64,
    /// How long an upload that can be resumed is kept after the last of its bytes.
    pub upload_kept_s: u64,
    /// The most bytes of all images together; further ones get 507. 0: as many as there is room for.
    pub images_max_bytes: u64,
    /// How long images are kept after their upload, in days; 0 is for ever.
    pub keep_images_days: u32,
    /// How long orientations with a green verdict are kept after their end, in days; 0 is for ever.
    pub keep_orientations_green_days: u32,
    /// How long those with a yellow verdict are kept.
    pub keep_orientations_yellow_days: u32,
    /// How long those with a red verdict are kept, and those that have failed or were cancelled.
    pub keep_orientations_red_days: u32,
    /// Room that uploads leave on the disk, for the database to go on.
    pub disk_reserve_bytes: u64,
    /// The largest body of any other request but an import of control points or scenes.
    pub body_max_bytes: usize,
    /// The largest body of an import of control points.
    pub import_max_bytes: usize,
    /// The largest building model that is imported by a request; `gable import` reads any.
    pub model_max_bytes: u64,
    /// The longest side of an image, in pixels.
    pub image_max_side_px: u32,
    /// The most pixels of a TIFF, which is read in windows.
    pub image_max_pixels: u64,
    /// The most pixels of a JPEG or PNG, which must be decoded as a whole.
    pub image_max_whole_pixels: u64,
    /// The most memory that decoding a JPEG or PNG may take.
    pub image_max_decode_bytes: u64,
    /// Memory for the pictures that are open to be looked at, tile by tile.
    pub viewer_cache_bytes: u64,
    /// The largest picture of a control scene that may be uploaded.
    pub scene_max_bytes: usize,
    /// The most pixels of the picture of a control scene.
    pub scene_max_pixels: u64,
    /// Connections at a time; further ones wait to be accepted.
    pub connections_max: usize,
    /// How long a client may take to send the head of a request, or leave a connection idle.
    pub head_timeout_s: u64,
    /// How long a client may pause while it sends a body.
    pub body_idle_timeout_s: u64,
    /// The least rate at which a body must come, once it has been waited for longer than a pause may be; 0 is any.
    pub body_min_bytes_per_s: u64,
    /// How long a client may take no more of an answer.
    pub answer_idle_timeout_s: u64,
    /// How long requests may go on after the order to stop.
    pub shutdown_timeout_s: u64,
    /// How long answers to requests with an `Idempotency-Key` are kept.
    pub idempotency_kept_s: u64,
    /// The longest `Prefer: wait` that is honoured.
    pub wait_max_s: u64,
    /// Whether `gable serve` orients images, or leaves it to `gable work`.
    pub work: bool,
    /// Images oriented at a time, each in a process of its own; 0 is one for each processor core.
    pub workers: usize,
    /// The most memory that the process which orients an image may have; 0 is any.
    pub worker_memory_max_bytes: u64,
    /// Threads of each such process; 0 is one for each processor core.
    pub worker_threads: usize,
    /// Orientations that may wait in the queue; further ones get 503.
    pub queue_max_jobs: u32,
    /// How often an orientation is tried that took the service down with it.
    pub job_max_attempts: u32,
    /// How long one attempt at an orientation may take.
    pub job_timeout_s: u64,
    /// What it costs to accept an orientation that is right.
    pub cost_cc: f64,
    /// What it costs to accept one that is wrong.
    pub cost_cw: f64,
    /// What it costs to reject one that is right.
    pub cost_wc: f64,
    /// What it costs to reject one that is wrong.
    pub cost_ww: f64,
    /// By how many times the odds of being wrong may be larger than the classifier says; 0: what it has shown in areas
    /// that it was not trained on.
    pub caution: f64,
    /// Green where the score exceeds it, T_d; if it is not given, it follows from costs and caution.
    pub threshold: Option<f64>,
    /// Classifiers that may wait to be trained; further ones get 503.
    pub training_max_jobs: u32,
    /// The largest labelled set that may be uploaded to train from.
    pub training_max_bytes: usize,
    /// Requests a second that one key, session or, without one, client address may go on making; 0 is any number.
    pub rate_per_s: f64,
    /// Requests that each of them may make at once.
    pub rate_burst: f64,
    /// Requests answered at a time; further ones get 503 at once.
    pub requests_max: usize,
    /// Whether TLS is in front of the service, so that browsers send cookies back through it alone; if it is not given,
    /// where it listens on more than the loopback interface.
    pub cookie_secure: Option<bool>,
    /// How long a login lasts that is not used.
    pub session_idle_s: u64,
    /// How long a login lasts at the most.
    pub session_max_s: u64,
    /// Hosts that webhooks may go to, with commas between them, `*.example.org` for all below one; empty: any public one.
    pub webhook_hosts: String,
    /// Whether webhooks may go to this machine, also by `http`; for tests.
    pub webhook_allow_loopback: bool,
    /// What signs webhooks, `whsec_` and base64; if it is not given, one is drawn and kept in the database.
    pub webhook_secret: Option<String>,
}

impl Default for Configuration {
    fn default() -> Self {
        Self {
            listen: SocketAddr::from(([127, 0, 0, 1], 8080)),
            data: PathBuf::from("gable-data"),
            geoid_folder: None,
            database_url: None,
            objects_url: None,
            log: String::from("info"),
            log_format: LogFormat::Text,
            upload_max_bytes: 2_000_000_000,
            upload_kept_s: 24 * 3600,
            images_max_bytes: 0,
            keep_images_days: 0,
            keep_orientations_green_days: 0,
            keep_orientations_yellow_days: 0,
            keep_orientations_red_days: 0,
            disk_reserve_bytes: 200_000_000,
            body_max_bytes: 1_000_000,
            import_max_bytes: 100_000_000,
            model_max_bytes: 2_000_000_000,
            image_max_side_px: 60_000,
            image_max_pixels: 1_000_000_000,
            image_max_whole_pixels: 120_000_000,
            image_max_decode_bytes: 512 << 20,
            viewer_cache_bytes: 256 << 20,
            scene_max_bytes: 16 << 20,
            scene_max_pixels: 16_000_000,
            connections_max: 4096,
            head_timeout_s: 10,
            body_idle_timeout_s: 30,
            body_min_bytes_per_s: 1000,
            answer_idle_timeout_s: 30,
            shutdown_timeout_s: 25,
            idempotency_kept_s: 24 * 3600,
            wait_max_s: 300,
            work: true,
            workers: 0,
            worker_memory_max_bytes: 8 << 30,
            worker_threads: 0,
            queue_max_jobs: 10_000,
            job_max_attempts: 3,
            job_timeout_s: 600,
            cost_cc: 0.0,
            cost_cw: 40.0,
            cost_wc: 5.0,
            cost_ww: 10.0,
            caution: 0.0,
            threshold: None,
            training_max_jobs: 10,
            training_max_bytes: 200_000_000,
            rate_per_s: 50.0,
            rate_burst: 200.0,
            requests_max: 512,
            cookie_secure: None,
            session_idle_s: 8 * 3600,
            session_max_s: 7 * 24 * 3600,
            webhook_hosts: String::new(),
            webhook_allow_loopback: false,
            webhook_secret: None,
        }
    }
}

/// One setting, for people.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Setting {
    /// Its name in the file; in the environment it has capitals and begins with `GABLE_`.
    pub name: String,
    /// What it is if nobody says.
    pub default: String,
    /// What it does.
    pub about: String,
}

/// A setting that cannot be used. One line, naming the key and what would be right.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ConfigurationError {
    /// A file, variable or flag cannot be read as its setting.
    #[error("{detail}")]
    Unreadable {
        /// What and where.
        detail: String,
    },
    /// A value makes no sense.
    #[error("{key} is {value}; it must be {wanted}")]
    OutOfRange {
        /// The setting.
        key: &'static str,
        /// As given.
        value: String,
        /// What would do.
        wanted: &'static str,
    },
}

const PREFIX: &str = "GABLE_";

/// Variables that begin with `GABLE_` and are no settings.
const OTHER_VARIABLES: [&str; 2] = ["GABLE_CONFIG", "GABLE_BOOTSTRAP_KEY"];

impl Configuration {
    /// Gathers the settings. `flags` are pairs of a setting's name and its value as text. Variables that begin with
    /// `GABLE_` but name no setting are left out and returned: an orchestrator may have set them.
    ///
    /// # Errors
    /// [`ConfigurationError`] names the first setting that cannot be used.
    pub fn gather(
        file: Option<&Path>,
        environment: impl IntoIterator<Item = (String, String)>,
        flags: &[(&'static str, String)],
    ) -> Result<(Self, Vec<String>), ConfigurationError> {
        let names: Vec<_> = Self::settings().into_iter().map(|setting| setting.name).collect();
        let (known, other): (HashMap<_, _>, HashMap<_, _>) = environment
            .into_iter()
            .filter(|(name, _)| name.starts_with(PREFIX) && !OTHER_VARIABLES.contains(&name.as_str()))
            .partition(|(name, _)| names.contains(&name[PREFIX.len()..].to_lowercase()));
        let mut builder = config::Config::builder();
        if let Some(file) = file {
            builder = builder.add_source(config::File::from(file).format(config::FileFormat::Toml));
        }
        let variables = config::Environment::with_prefix("GABLE").try_parsing(true).source(Some(known));
        builder = builder.add_source(variables);
        for (name, value) in flags {
            builder = builder.set_override(*name, value.as_str()).map_err(unreadable)?;
        }
        let configuration: Self = builder.build().and_then(config::Config::try_deserialize).map_err(unreadable)?;
        configuration.check()?;
        let mut ignored: Vec<String> = other.into_keys().collect();
        ignored.sort_unstable();
        Ok((configuration, ignored))
    }

    /// All settings by name, with the comments of this file.
    #[must_use]
    pub fn settings() -> Vec<Setting> {
        let defaults = serde_json::to_value(Self::default()).unwrap_or_default();
        let RefOr::T(Schema::Object(schema)) = Self::schema() else {
            return Vec::new();
        };
        let setting = |(name, about): (String, RefOr<Schema>)| {
            let default = &defaults[&name];
            let default = match default {
                serde_json::Value::String(text) => text.clone(),
                serde_json::Value::Null => "(not given)".to_owned(),
                other => other.to_string(),
            };
            let about = match about {
                RefOr::T(Schema::Object(about)) => about.description.unwrap_or_default(),
                _ => String::new(),
            };
            Setting { name, default, about }
        };
        schema.properties.into_iter().map(setting).collect()
    }

    /// Images oriented at a time.
    #[must_use]
    pub fn worker_count(&self) -> usize {
        match self.workers {
            0 => std::thread::available_parallelism().map_or(1, usize::from),
            given => given,
        }
    }

    /// Where geoid grids are looked for.
    #[must_use]
    pub fn geoid_folder(&self) -> PathBuf {
        self.geoid_folder.clone().unwrap_or_else(|| self.data.join("geoids"))
    }

    /// Where the store is.
    #[must_use]
    pub fn place(&self) -> Place<'_> {
        Place {
            folder: &self.data,
            database_url: self.database_url.as_deref(),
            objects_url: self.objects_url.as_deref(),
        }
    }

    /// What is read of pictures; what is no setting is as the room of the pictures has it.
    #[must_use]
    pub fn image_limits(&self) -> Limits {
        Limits {
            max_side_px: self.image_max_side_px,
            max_pixels: self.image_max_pixels,
            max_whole_pixels: self.image_max_whole_pixels,
            max_decode_bytes: self.image_max_decode_bytes,
            ..Limits::default()
        }
    }

    /// What is read of the pictures of control scenes.
    #[must_use]
    pub fn scene_limits(&self) -> Limits {
        let limits = self.image_limits();
        Limits {
            max_pixels: limits.max_pixels.min(self.scene_max_pixels),
            max_whole_pixels: limits.max_whole_pixels.min(self.scene_max_pixels),
            ..limits
        }
    }

    /// How long answers to requests with an `Idempotency-Key` are kept.
    #[must_use]
    pub fn idempotency_kept(&self) -> Duration {
        Duration::from_secs(self.idempotency_kept_s)
    }

    fn check(&self) -> Result<(), ConfigurationError> {
        let positive: [(&'static str, u64); 24] = [
            ("viewer_cache_bytes", self.viewer_cache_bytes),
            ("upload_max_bytes", self.upload_max_bytes),
            ("upload_kept_s", self.upload_kept_s),
            ("body_max_bytes", self.body_max_bytes as u64),
            ("import_max_bytes", self.import_max_bytes as u64),
            ("model_max_bytes", self.model_max_bytes),
            ("image_max_side_px", self.image_max_side_px.into()),
            ("image_max_pixels", self.image_max_pixels),
            ("image_max_whole_pixels", self.image_max_whole_pixels),
            ("image_max_decode_bytes", self.image_max_decode_bytes),
            ("scene_max_bytes", self.scene_max_bytes as u64),
            ("scene_max_pixels", self.scene_max_pixels),
            ("connections_max", self.connections_max as u64),
            ("head_timeout_s", self.head_timeout_s),
            ("body_idle_timeout_s", self.body_idle_timeout_s),
            ("answer_idle_timeout_s", self.answer_idle_timeout_s),
            ("idempotency_kept_s", self.idempotency_kept_s),
            ("queue_max_jobs", self.queue_max_jobs.into()),
            ("job_max_attempts", self.job_max_attempts.into()),
            ("job_timeout_s", self.job_timeout_s),
            ("training_max_jobs", self.training_max_jobs.into()),
            ("training_max_bytes", self.training_max_bytes as u64),
            ("requests_max", self.requests_max as u64),
            ("session_max_s", self.session_max_s),
        ];
        for (key, value) in positive {
            if value == 0 {
                return Err(ConfigurationError::OutOfRange { key, value: value.to_string(), wanted: "at least 1" });
            }
        }
        const LONGEST_S: u64 = 366 * 24 * 3600;
        let durations = [
            ("head_timeout_s", self.head_timeout_s),
            ("body_idle_timeout_s", self.body_idle_timeout_s),
            ("answer_idle_timeout_s", self.answer_idle_timeout_s),
            ("shutdown_timeout_s", self.shutdown_timeout_s),
            ("idempotency_kept_s", self.idempotency_kept_s),
            ("wait_max_s", self.wait_max_s),
            ("upload_kept_s", self.upload_kept_s),
            ("job_timeout_s", self.job_timeout_s),
            ("session_idle_s", self.session_idle_s),
            ("session_max_s", self.session_max_s),
        ];
        for (key, value) in durations {
            if value > LONGEST_S {
                return Err(ConfigurationError::OutOfRange { key, value: value.to_string(), wanted: "at most a year" });
            }
        }
        self.check_costs()?;
        self.check_days()?;
        for (key, value) in [("connections_max", self.connections_max), ("requests_max", self.requests_max)] {
            if value > tokio::sync::Semaphore::MAX_PERMITS {
                let value = value.to_string();
                return Err(ConfigurationError::OutOfRange { key, value, wanted: "a sensible number" });
            }
        }
        self.check_callers()
    }
}

impl Configuration {
    /// What the verdicts follow where a request does not say.
    #[must_use]
    pub fn policy(&self) -> Policy {
        let costs = Costs { cc: self.cost_cc, cw: self.cost_cw, wc: self.cost_wc, ww: self.cost_ww };
        Policy { costs, caution: (self.caution >= 1.0).then_some(self.caution), threshold: self.threshold }
    }

    fn check_days(&self) -> Result<(), ConfigurationError> {
        const MOST_DAYS: u32 = 36_600;
        let days = [
            ("keep_images_days", self.keep_images_days),
            ("keep_orientations_green_days", self.keep_orientations_green_days),
            ("keep_orientations_yellow_days", self.keep_orientations_yellow_days),
            ("keep_orientations_red_days", self.keep_orientations_red_days),
        ];
        match days.into_iter().find(|(_, days)| *days > MOST_DAYS) {
            Some((key, days)) => {
                let wanted = "at most 36600, a hundred years; 0 is for ever";
                Err(ConfigurationError::OutOfRange { key, value: days.to_string(), wanted })
            }
            None => Ok(()),
        }
    }

    fn check_costs(&self) -> Result<(), ConfigurationError> {
        let costs = [
            ("cost_cc", self.cost_cc),
            ("cost_cw", self.cost_cw),
            ("cost_wc", self.cost_wc),
            ("cost_ww", self.cost_ww),
        ];
        for (key, value) in costs {
            if !(0.0..=1e9).contains(&value) {
                return Err(ConfigurationError::OutOfRange { key, value: value.to_string(), wanted: "from 0 to 1e9" });
            }
        }
        if self.policy().costs.least_probability().is_none() {
            let value = self.cost_cw.to_string();
            let wanted = "more than cost_ww, or accepting what is wrong would pay";
            return Err(ConfigurationError::OutOfRange { key: "cost_cw", value, wanted });
        }
        if let Some(threshold) = self.threshold.filter(|threshold| !(-1e6..=1e6).contains(threshold)) {
            let value = threshold.to_string();
            return Err(ConfigurationError::OutOfRange { key: "threshold", value, wanted: "from -1e6 to 1e6" });
        }
        if self.caution != 0.0 && !(1.0..=1e6).contains(&self.caution) {
            let value = self.caution.to_string();
            return Err(ConfigurationError::OutOfRange { key: "caution", value, wanted: "0, or from 1 to 1e6" });
        }
        Ok(())
    }
}

fn unreadable(error: impl std::fmt::Display) -> ConfigurationError {
    let detail = error.to_string().split_whitespace().collect::<Vec<_>>().join(" ");
    ConfigurationError::Unreadable { detail }
}
