//! The Python peers, each a process of its own that runs once for every line it is sent.

use std::io::{BufRead as _, BufReader, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

use anyhow::{Context as _, Result, bail};
use serde_json::Value;

/// Where the peers and the real images are.
pub struct Peers {
    python: PathBuf,
    scripts: PathBuf,
    /// `../shared/bench`.
    pub images: PathBuf,
    /// For files that are made once and kept.
    pub cache: PathBuf,
}

impl Peers {
    /// By `GABLE_PEERS` and `GABLE_BENCH`, else where `benches/peers/install` and the repository have them.
    pub fn find() -> Result<Self> {
        let root = Path::new(env!("CARGO_MANIFEST_DIR"));
        let folder = |variable: &str, usual: &str| std::env::var_os(variable).map_or(root.join(usual), PathBuf::from);
        let peers = Self {
            python: folder("GABLE_PEERS", "target/peers").join("bin/python"),
            scripts: root.join("benches/peers"),
            images: folder("GABLE_BENCH", "../shared/bench"),
            cache: root.join("target/bench"),
        };
        if !peers.python.exists() {
            bail!("there is no {}; run benches/peers/install", peers.python.display());
        }
        if !peers.images.exists() {
            bail!("there are no images at {}; set GABLE_BENCH", peers.images.display());
        }
        std::fs::create_dir_all(&peers.cache)?;
        Ok(peers)
    }

    fn command(&self, script: &str) -> Command {
        let mut command = Command::new(&self.python);
        command.arg(self.scripts.join(script));
        command
    }

    /// Runs a script to its end.
    pub fn once(&self, script: &str, arguments: &[&str]) -> Result<()> {
        let status = self.command(script).args(arguments).status()?;
        if status.success() { Ok(()) } else { bail!("{script} {arguments:?}: {status}") }
    }

    /// Starts a peer that reads its inputs from a folder.
    pub fn start(&self, script: &str, folder: &Path) -> Result<Peer> {
        self.start_with(script, folder, &[])
    }

    /// The same with further arguments.
    pub fn start_with(&self, script: &str, folder: &Path, arguments: &[&str]) -> Result<Peer> {
        let mut command = self.command(script);
        let mut child = command
            .arg(folder)
            .args(arguments)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .context("python")?;
        let (input, output) = child.stdin.take().zip(child.stdout.take()).context("its pipes")?;
        let mut peer = Peer { child, input, output: BufReader::new(output), script: script.to_owned() };
        match peer.line()?.as_str() {
            "ready" => Ok(peer),
            other => bail!("{script} says {other:?}"),
        }
    }
}

/// A running peer; it ends with this.
pub struct Peer {
    child: Child,
    input: ChildStdin,
    output: BufReader<ChildStdout>,
    script: String,
}

impl Peer {
    /// One run: what it tells, and its CPU seconds.
    pub fn run(&mut self, request: &str) -> Result<(Value, f64)> {
        writeln!(self.input, "{request}")?;
        self.input.flush()?;
        let told: Value = serde_json::from_str(&self.line()?).with_context(|| self.script.clone())?;
        let used = told["cpu_s"].as_f64().context("cpu_s")?;
        Ok((told, used))
    }

    fn line(&mut self) -> Result<String> {
        let mut line = String::new();
        if self.output.read_line(&mut line)? == 0 {
            bail!("{} has ended before its time", self.script);
        }
        Ok(line.trim_end().to_owned())
    }
}

impl Drop for Peer {
    fn drop(&mut self) {
        // it may have ended by itself
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Writes rows of numbers as the peers read them.
pub fn write_array(folder: &Path, name: &str, values: impl IntoIterator<Item = f64>) -> Result<()> {
    let bytes: Vec<u8> = values.into_iter().flat_map(f64::to_le_bytes).collect();
    Ok(std::fs::write(folder.join(name), bytes)?)
}
