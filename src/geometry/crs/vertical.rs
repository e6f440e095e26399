//! Height systems, and the grids that lead to them from the ellipsoid.
//!
//! Codes and accuracies are those of the EPSG register (11.022), names of the grids those of PROJ-data
//! (<https://cdn.proj.org>); the grid of DHHN92 is distributed by BKG alone, and is expected by the name that it would have.

use std::sync::Arc;

use super::CrsError;
use crate::geometry::geoid::{self, GeoidFault, Geoids, NamedGrid};

/// A system of heights above a geoid or quasi-geoid.
#[derive(Debug, PartialEq)]
pub(super) struct VerticalSystem {
    /// Its code in the EPSG register.
    pub(super) code: u32,
    /// What it is called there.
    pub(super) name: &'static str,
    /// Grids that lead to it, those to be preferred first; file names without their ending.
    pub(super) grids: &'static [&'static str],
    /// How well the best of them is known, and of a frame that is not that of WGS 84 or ETRS89 also what lies between.
    pub(super) accuracy_m: f64,
}

const fn system(code: u32, name: &'static str, accuracy_m: f64, grids: &'static [&'static str]) -> VerticalSystem {
    VerticalSystem { code, name, grids, accuracy_m }
}

/// NAD83(2011), on which the grids of NAVD88 lie, is taken as WGS 84, as the register does (EPSG:9774 and its like,
/// 2 m): that is most of the uncertainty of heights in it.
#[rustfmt::skip]
static SYSTEMS: [VerticalSystem; 17] = [
    system(7837, "DHHN2016 height", 0.02, &["de_bkg_gcg2016"]),
    system(5783, "DHHN92 height", 0.03, &["de_bkg_gcg2011"]),
    system(5773, "EGM96 height", 1.0, &["us_nga_egm96_15", "egm96_15"]),
    system(3855, "EGM2008 height", 1.0, &["us_nga_egm08_25", "egm08_25"]),
    system(5703, "NAVD88 height", 2.0, &["us_noaa_g2018u0", "us_noaa_g2012bu0", "us_noaa_g2012ba0", "us_noaa_geoid09_conus", "us_noaa_geoid09_ak"]),
    system(5621, "EVRF2007 height", 0.03, &["sk_gku_Slovakia_ETRS89h_to_EVRF2007"]),
    system(9651, "EVRF2007-PL height", 0.02, &["pl_gugik_geoid2021-PL-EVRF2007-NH", "pl_gugik_geoid2011-PL-EVRF2007-NH"]),
    system(9650, "Baltic 1986 height", 0.03, &["pl_gugik_geoid2011-PL-KRON86-NH"]),
    system(6695, "JGD2011 (vertical) height", 0.02, &["jp_gsi_gsigeo2011"]),
    system(5709, "NAP height", 0.01, &["nl_nsgi_nlgeo2018"]),
    system(5710, "Ostend height", 0.02, &["be_ign_hBG18"]),
    system(5720, "NGF-IGN69 height", 0.01, &["fr_ign_RAF20", "fr_ign_RAF18b", "fr_ign_RAF18"]),
    system(5728, "LN02 height", 0.05, &["ch_swisstopo_chgeo2004_ETRS89_LN02"]),
    system(5701, "ODN height", 0.01, &["uk_os_OSGM15_GB"]),
    system(5941, "NN2000 height", 0.02, &["no_kv_HREF2018B_NN2000_EUREF89"]),
    system(5613, "RH2000 height", 0.02, &["se_lantmateriet_SWEN17_RH2000"]),
    system(8357, "Baltic 1957 height", 0.03, &["cz_cuzk_CR-2005", "sk_gku_Slovakia_ETRS89h_to_Baltic1957"]),
];

/// What [`find`] understands, for the error message.
pub(super) const KNOWN: &str = "7837 (DHHN2016), 5783 (DHHN92), 5773 (EGM96), 3855 (EGM2008), 5703 (NAVD88), 5621 (EVRF2007), \
    9651 (EVRF2007-PL), 9650 (Baltic 1986), 6695 (JGD2011), 5709 (NAP), 5710 (Ostend), 5720 (NGF-IGN69), 5728 (LN02), 5701 \
    (ODN), 5941 (NN2000), 5613 (RH2000), 8357 (Baltic 1957)";

/// The system with a code of the EPSG register.
pub(super) fn find(code: u32) -> Option<&'static VerticalSystem> {
    SYSTEMS.iter().find(|system| system.code == code)
}

/// All of them with their grids, for people.
pub(super) fn all() -> impl Iterator<Item = &'static VerticalSystem> {
    SYSTEMS.iter()
}

/// The heights of a compound system.
#[derive(Debug, Clone)]
pub(super) struct Heights {
    pub(super) system: &'static VerticalSystem,
    /// Where its grids are looked for, if not where all of the process are.
    pub(super) geoids: Option<Arc<dyn Geoids>>,
}

impl Heights {
    /// The zero of the heights above the ellipsoid at a place, for a system with the name `crs`.
    pub(super) fn undulation_m(&self, crs: &str, longitude_deg: f64, latitude_deg: f64) -> Result<f64, CrsError> {
        let grids = self.grids(crs)?;
        for NamedGrid { name, grid } in grids.iter() {
            match grid.undulation_m(longitude_deg, latitude_deg) {
                Ok(undulation_m) => return Ok(undulation_m),
                Err(GeoidFault::Outside) => {}
                Err(fault) => return Err(unreadable(crs, name, fault.to_string())),
            }
        }
        let (crs, heights) = (crs.to_owned(), self.system.name);
        Err(CrsError::OutsideGeoidGrid { crs, heights, longitude_deg, latitude_deg })
    }

    /// Whether there is a grid at all.
    pub(super) fn check(&self, crs: &str) -> Result<(), CrsError> {
        self.grids(crs).map(|_| ())
    }

    /// The grids of the system that are there, at least one.
    fn grids(&self, crs: &str) -> Result<Arc<[NamedGrid]>, CrsError> {
        let geoids = self.geoids.as_ref().or_else(|| geoid::installed()).ok_or_else(|| self.missing(crs))?;
        let grids = geoids.grids(self.system.grids).map_err(|fault| unreadable(crs, &fault.name, fault.reason))?;
        if grids.is_empty() { Err(self.missing(crs)) } else { Ok(grids) }
    }

    fn missing(&self, crs: &str) -> CrsError {
        let files: Vec<String> = self.system.grids.iter().map(|name| format!("{name}.tif")).collect();
        CrsError::GeoidGridMissing { given: crs.to_owned(), heights: self.system.name, files: files.join(" or ") }
    }
}

fn unreadable(crs: &str, name: &str, reason: String) -> CrsError {
    CrsError::GeoidGridUnreadable { crs: crs.to_owned(), file: name.to_owned(), reason }
}
