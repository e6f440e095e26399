//! `gable block`: a flight's list and its images to a service, with a bar that shows how far it is.

use std::path::{Path, PathBuf};
use std::time::Duration;

use crate::imagery::Format;
use anyhow::{Context as _, bail};
use clap::{Args, Subcommand};
use indicatif::{ProgressBar, ProgressStyle};
use reqwest::{Client, RequestBuilder, Response, StatusCode, Url};
use serde_json::Value;

use super::print;

const EXAMPLES: &str = "Example:
  gable block post flight.csv --images scans --camera rmk-top-15 --crs EPSG:25832 --tolerance-gsd 5";

/// Orient the images of a flight by a service
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(super) struct BlockCommand {
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, Subcommand)]
enum Action {
    Post(Box<Post>),
}

/// Post the list of a flight and upload its images
#[derive(Debug, Args)]
struct Post {
    /// The list: CSV with a header (.csv), GeoJSON points (.geojson, .json), or lines `name X Y Z [omega phi kappa]`.
    list: PathBuf,
    /// Folder of the images; they have the names of the list, with or without the ending of their format.
    #[arg(long, value_name = "FOLDER")]
    images: PathBuf,
    /// The service.
    #[arg(long, default_value = "http://127.0.0.1:8080")]
    url: Url,
    /// A key, if the service wants one.
    #[arg(long, env = "GABLE_KEY", hide_env_values = true)]
    key: Option<String>,
    /// Id or name of the camera.
    #[arg(long)]
    camera: String,
    /// CRS of the list. [default: EPSG:4979]
    #[arg(long)]
    crs: Option<String>,
    /// Unit of the angles: deg or gon. [default: deg]
    #[arg(long)]
    angles: Option<String>,
    /// Name of the block.
    #[arg(long)]
    name: Option<String>,
    /// Standard deviations of the positions: one number, or east,north,up.
    #[arg(long, value_name = "METRES")]
    sigma_position_m: Option<String>,
    /// The largest acceptable error on the ground, in ground sample distances. [default: 10]
    #[arg(long)]
    tolerance_gsd: Option<f64>,
    /// CRS of the results. [default: that of the list]
    #[arg(long)]
    output_crs: Option<String>,
    /// low, normal or high. [default: normal]
    #[arg(long)]
    priority: Option<String>,
}

impl BlockCommand {
    pub(super) async fn run(self) -> anyhow::Result<()> {
        match self.action {
            Action::Post(post) => post.run().await,
        }
    }
}

/// So often an image is sent again that the service had no room for at the time.
const MOST_TRIES: u32 = 100;

impl Post {
    async fn run(&self) -> anyhow::Result<()> {
        // it is chosen once in a process; somebody may have done so
        let _ = rustls::crypto::ring::default_provider().install_default();
        let client = Client::builder().build().context("no client of HTTP can be made")?;
        let block = self.post_list(&client).await?;
        let names = self.names(&client, &block).await?;
        let bar = ProgressBar::new(names.len() as u64);
        bar.set_style(ProgressStyle::with_template("{bar:40} {pos}/{len} images, {eta} left {msg}")?);
        let (mut sent, mut missing, mut refused) = (0, Vec::new(), Vec::new());
        for name in &names {
            match file_of(&self.images, name) {
                None => missing.push(name),
                Some((file, format)) => match self.put(&client, &block, name, &file, format).await {
                    Ok(()) => sent += 1,
                    Err(error) => refused.push(format!("{name}: {error:#}")),
                },
            }
            bar.inc(1);
        }
        bar.finish_and_clear();
        print(&format!("block {block}: {sent} of {} images uploaded", names.len()))?;
        for name in &missing {
            print(&format!("no file for {name}"))?;
        }
        for refusal in &refused {
            print(refusal)?;
        }
        match missing.len() + refused.len() {
            0 => Ok(()),
            count => bail!("not uploaded: {count}; post the same files again by PUT, or remove the block"),
        }
    }

    async fn post_list(&self, client: &Client) -> anyhow::Result<String> {
        let list = tokio::fs::read(&self.list).await;
        let list = list.with_context(|| format!("cannot read {}", self.list.display()))?;
        let ending = self.list.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase();
        let kind = match ending.as_str() {
            "csv" | "tsv" => "text/csv",
            "geojson" | "json" => "application/geo+json",
            _ => "text/plain",
        };
        let mut url = self.address(&[])?;
        let tolerance_gsd = self.tolerance_gsd.map(|tolerance| tolerance.to_string());
        let settings = [
            ("camera", Some(&self.camera)),
            ("crs", self.crs.as_ref()),
            ("angles", self.angles.as_ref()),
            ("name", self.name.as_ref()),
            ("sigma_position_m", self.sigma_position_m.as_ref()),
            ("tolerance_gsd", tolerance_gsd.as_ref()),
            ("output_crs", self.output_crs.as_ref()),
            ("priority", self.priority.as_ref()),
        ];
        for (name, value) in settings {
            if let Some(value) = value {
                url.query_pairs_mut().append_pair(name, value);
            }
        }
        let answer = self.send(client.post(url).header("content-type", kind).body(list)).await?;
        let block: Value = serde_json::from_slice(&answered(answer).await?)?;
        Ok(block["id"].as_str().context("the answer has no id")?.to_owned())
    }

    /// The names of the list, as the service has read it.
    async fn names(&self, client: &Client, block: &str) -> anyhow::Result<Vec<String>> {
        let (mut names, mut cursor) = (Vec::new(), None);
        loop {
            let mut url = self.address(&[block, "images"])?;
            url.query_pairs_mut()
                .append_pair("limit", "200")
                .extend_pairs(cursor.map(|cursor: String| ("cursor", cursor)));
            let page: Value = serde_json::from_slice(&answered(self.send(client.get(url)).await?).await?)?;
            let items = page["items"].as_array().into_iter().flatten();
            names.extend(items.filter_map(|item| item["name"].as_str()).map(str::to_owned));
            match page["next_cursor"].as_str() {
                Some(next) => cursor = Some(next.to_owned()),
                None => return Ok(names),
            }
        }
    }

    async fn put(&self, client: &Client, block: &str, name: &str, file: &Path, format: Format) -> anyhow::Result<()> {
        for _ in 0..MOST_TRIES {
            let opened =
                tokio::fs::File::open(file).await.with_context(|| format!("cannot read {}", file.display()))?;
            let length = opened.metadata().await?.len();
            let put = client.put(self.address(&[block, "images", name])?).header("content-type", format.media_type());
            let answer = self.send(put.header("content-length", length).body(opened)).await?;
            if answer.status() != StatusCode::SERVICE_UNAVAILABLE {
                answered(answer).await?;
                return Ok(());
            }
            let wait_s = answer.headers().get("retry-after").and_then(|wait| wait.to_str().ok()?.parse().ok());
            tokio::time::sleep(Duration::from_secs(wait_s.unwrap_or(10).min(60))).await;
        }
        bail!("the service has had no room for it {MOST_TRIES} times")
    }

    async fn send(&self, request: RequestBuilder) -> anyhow::Result<Response> {
        let request = match &self.key {
            Some(key) => request.bearer_auth(key),
            None => request,
        };
        request.send().await.with_context(|| format!("{} does not answer", self.url))
    }

    /// An address below that of the blocks; the parts may have any characters.
    fn address(&self, parts: &[&str]) -> anyhow::Result<Url> {
        let mut url = self.url.join("/api/v1/blocks")?;
        url.path_segments_mut().map_err(|()| anyhow::anyhow!("{} is no address of a service", self.url))?.extend(parts);
        Ok(url)
    }
}

/// The body, or what the service says is wrong.
async fn answered(answer: Response) -> anyhow::Result<Vec<u8>> {
    let status = answer.status();
    let body = answer.bytes().await?;
    if status.is_success() {
        return Ok(body.to_vec());
    }
    let problem: Value = serde_json::from_slice(&body).unwrap_or_default();
    let lines = problem["errors"].as_array().into_iter().flatten();
    let lines = lines.map(|error| {
        let text = |name: &str| error[name].as_str().unwrap_or_default().to_owned();
        format!("\n  {}: {}", text("pointer"), text("detail"))
    });
    bail!("{status}: {}{}", problem["detail"].as_str().unwrap_or("no reason given"), lines.collect::<String>())
}

/// The file of a name in a folder, and its format by its ending.
fn file_of(folder: &Path, name: &str) -> Option<(PathBuf, Format)> {
    const ENDINGS: [(&str, Format); 5] = [
        ("jpg", Format::Jpeg),
        ("jpeg", Format::Jpeg),
        ("png", Format::Png),
        ("tif", Format::Tiff),
        ("tiff", Format::Tiff),
    ];
    let format_of = |path: &Path| {
        let ending = path.extension()?.to_string_lossy().to_ascii_lowercase();
        ENDINGS.iter().find(|(known, _)| *known == ending).map(|(_, format)| *format)
    };
    let whole = folder.join(name);
    let with_endings = ENDINGS.iter().flat_map(|(ending, _)| {
        [ending.to_string(), ending.to_ascii_uppercase()].map(|ending| folder.join(format!("{name}.{ending}")))
    });
    let found = std::iter::once(whole).chain(with_endings).find(|path| format_of(path).is_some() && path.is_file())?;
    let format = format_of(&found)?;
    Some((found, format))
}
