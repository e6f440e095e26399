//! `gable crs`.

use std::io::{BufRead as _, BufReader, BufWriter, Read, Write as _};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use crate::geoids::{Found, GeoidFolder, first_used};
use crate::geometry::{Crs, CrsError};
use anyhow::{Context as _, bail};
use clap::{Args, Subcommand};

use super::{geoids_of_environment, print};

const TRANSFORM_EXAMPLES: &str = "\
Examples:
  echo '365910.342 5621522.061 123.4' | gable crs transform --from EPSG:25832+7837 --to EPSG:4979
      From UTM with heights above the German quasi-geoid to longitude, latitude and ellipsoidal height.

  gable crs transform --from EPSG:4979 --to EPSG:25832+7837 --geoids /usr/share/proj centres.csv > heights.txt
      A file of longitudes, latitudes and heights, with commas or blanks between; what follows them is kept.";

const LIST_EXAMPLES: &str = "\
Example:
  gable crs heights --geoids /usr/share/proj
      Shows the height systems, the grids that each needs, and which of them are there.";

/// Transform positions between systems; show height systems and their geoid grids
#[derive(Debug, Args)]
#[command(after_help = TRANSFORM_EXAMPLES)]
pub(crate) struct CrsCommand {
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, Subcommand)]
enum Action {
    Transform(Box<Transform>),
    Heights(Heights),
}

/// Transform positions from one CRS to another, a line each
///
/// East or longitude comes first, then north or latitude, then up, whatever the register says. A position that cannot be
/// transformed becomes three stars, and its reason goes to the standard error.
#[derive(Debug, Args)]
#[command(after_help = TRANSFORM_EXAMPLES)]
struct Transform {
    /// Text file with positions. [default: standard input]
    file: Option<PathBuf>,
    /// CRS of the positions: EPSG:<code>, EPSG:<horizontal>+<vertical> or a PROJ string.
    #[arg(long, value_name = "CRS")]
    from: Crs,
    /// CRS to transform to.
    #[arg(long, value_name = "CRS")]
    to: Crs,
    /// Decimals of metres; degrees get five more.
    #[arg(long, value_name = "N", default_value_t = 4, value_parser = clap::value_parser!(u8).range(0..=9))]
    decimals: u8,
    /// Folder with geoid grids. [default: as configured]
    #[arg(long, value_name = "FOLDER")]
    geoids: Option<PathBuf>,
}

/// Show the height systems that are known, and the geoid grids that they need
#[derive(Debug, Args)]
#[command(after_help = LIST_EXAMPLES)]
struct Heights {
    /// Folder with geoid grids. [default: as configured]
    #[arg(long, value_name = "FOLDER")]
    geoids: Option<PathBuf>,
}

impl CrsCommand {
    pub(crate) async fn run(self) -> anyhow::Result<()> {
        let work = move || match self.action {
            Action::Transform(command) => (*command).run(),
            Action::Heights(command) => command.run(),
        };
        tokio::task::spawn_blocking(work).await?
    }
}

fn folder(given: Option<&Path>) -> anyhow::Result<Arc<GeoidFolder>> {
    Ok(Arc::new(match given {
        Some(folder) => GeoidFolder::new(folder),
        None => GeoidFolder::new(geoids_of_environment()?),
    }))
}

impl Transform {
    fn run(self) -> anyhow::Result<()> {
        let geoids = folder(self.geoids.as_deref())?;
        let (from, to) = (self.from.with_geoids(geoids.clone()), self.to.with_geoids(geoids));
        from.check_heights(None)?;
        to.check_heights(None)?;
        let input: Box<dyn Read> = match &self.file {
            Some(file) => {
                Box::new(std::fs::File::open(file).with_context(|| format!("cannot read {}", file.display()))?)
            }
            None => Box::new(std::io::stdin()),
        };
        let metres = usize::from(self.decimals);
        let plane = if to.is_geographic() { metres + 5 } else { metres };
        let mut output = BufWriter::new(std::io::stdout().lock());
        let (mut lines, mut failed) = (0, 0);
        for line in BufReader::new(input).lines() {
            let line = line.context("the positions cannot be read")?;
            lines += 1;
            if line.trim().is_empty() || line.starts_with('#') {
                continue;
            }
            let (position, rest) = position(&line).with_context(|| format!("line {lines}"))?;
            let transformed = transform(&from, &to, position);
            let written = match transformed {
                Ok([x, y, z]) => writeln!(output, "{x:.plane$} {y:.plane$} {z:.metres$}{rest}"),
                Err(error) => {
                    failed += 1;
                    eprintln!("line {lines}: {error}");
                    writeln!(output, "* * *{rest}")
                }
            };
            match written {
                Err(error) if error.kind() == std::io::ErrorKind::BrokenPipe => return Ok(()),
                other => other.context("cannot print")?,
            }
        }
        output.flush().context("cannot print")?;
        if failed > 0 {
            bail!("{failed} positions could not be transformed");
        }
        Ok(())
    }
}

impl Heights {
    fn run(self) -> anyhow::Result<()> {
        let folder = folder(self.geoids.as_deref())?;
        let found = folder.found();
        for system in Crs::height_systems() {
            print(&format!("EPSG:{}  {}", system.code, system.name))?;
            for name in system.grids {
                let state = match found.iter().find(|found| found.name == *name) {
                    None => "not there".to_owned(),
                    Some(Found { fault: Some(fault), .. }) => fault.clone(),
                    Some(_) if first_used(system, &found) == Some(*name) => "used".to_owned(),
                    Some(_) => "used where those above do not reach".to_owned(),
                };
                print(&format!("    {name}  {state}"))?;
            }
        }
        Ok(())
    }
}

fn transform(from: &Crs, to: &Crs, position: [f64; 3]) -> Result<[f64; 3], CrsError> {
    to.position_from_geocentric(from.geocentric_from_position(position, None)?, None)
}

/// Three numbers at the beginning of a line with blanks or commas between them, and what follows.
fn position(line: &str) -> anyhow::Result<([f64; 3], &str)> {
    let is_between = |c: char| c.is_whitespace() || c == ',' || c == ';';
    let (mut rest, mut position) = (line, [0.0; 3]);
    for coordinate in &mut position {
        rest = rest.trim_start_matches(is_between);
        let (word, behind) = rest.split_at(rest.find(is_between).unwrap_or(rest.len()));
        *coordinate = word.parse().with_context(|| format!("it must begin with three numbers; {word:?} is none"))?;
        rest = behind;
    }
    Ok((position, rest))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_numbers_are_read_and_the_rest_is_kept() {
        assert_eq!(position("7.1 50.2 123").unwrap(), ([7.1, 50.2, 123.0], ""));
        assert_eq!(position(" 7.1, 50.2,-1e2, church").unwrap(), ([7.1, 50.2, -100.0], ", church"));
        for wrong in ["", "1 2", "1 2 x", "name 1 2 3"] {
            assert!(position(wrong).is_err(), "{wrong}");
        }
    }
}
