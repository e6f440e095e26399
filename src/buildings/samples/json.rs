//! CityJSON like 3DBAG's.

use std::io::{Result, Write};

use super::house::{Body, House, Point};
use super::{Sample, SampleBuilding, Town};

/// Where the integers of the file begin.
const TRANSLATE: [f64; 3] = [80_000.0, 430_000.0, 0.0];

/// What 3DBAG tells of every building, and no reader of roofs needs.
const ATTRIBUTES: &str = concat!(
    r#""status":"Pand in gebruik","oorspronkelijkbouwjaar":1972,"documentdatum":"2014-03-19","#,
    r#""documentnummer":"INT2014-0319","eindgeldigheid":null,"eindregistratie":null,"geconstateerd":false,"#,
    r#""tijdstipregistratie":"2014-03-20T10:12:43","voorkomenidentificatie":1,"b3_bag_bag_overlap":0.0,"b3_dak_type":"slanted","#,
    r#""b3_extrusie":"standard","b3_h_maaiveld":1.2479999,"b3_h_dak_50p":7.518,"b3_h_dak_70p":8.431,"b3_h_dak_max":9.874,"#,
    r#""b3_h_dak_min":4.112,"b3_kas_warenhuis":false,"b3_kwaliteitsindicator":true,"b3_mutatie_ahn3_ahn4":false,"#,
    r#""b3_nodata_fractie_ahn3":0.0193,"b3_nodata_fractie_ahn4":0.0088,"b3_nodata_radius_ahn3":0.7071,"b3_opp_buitenmuur":143.22,"#,
    r#""b3_opp_dak_plat":0.0,"b3_opp_dak_schuin":98.51,"b3_opp_grond":77.62,"b3_opp_scheidingsmuur":51.09,"b3_pw_bron":"AHN4","#,
    r#""b3_pw_datum":2020,"b3_pw_selectie_reden":"PREFERRED_AND_LATEST","b3_puntdichtheid_ahn3":10.81,"b3_rmse_lod12":2.071,"#,
    r#""b3_rmse_lod13":1.934,"b3_rmse_lod22":0.0402,"b3_reconstructie_onvolledig":false,"b3_val3dity_lod12":"[]","#,
    r#""b3_val3dity_lod13":"[]","b3_val3dity_lod22":"[]","b3_volume_lod12":512.43,"b3_volume_lod13":509.06,"#,
    r#""b3_volume_lod22":488.17"#,
);

/// The vertices of a house, each once.
#[derive(Default)]
struct Vertices(Vec<[i64; 3]>);

impl Vertices {
    fn index(&mut self, sample: Sample, point: Point) -> usize {
        let placed = sample.place(point);
        let whole = std::array::from_fn(|axis| ((placed[axis] - TRANSLATE[axis]) * 1e3).round() as i64);
        self.0.iter().position(|other| *other == whole).unwrap_or_else(|| {
            self.0.push(whole);
            self.0.len() - 1
        })
    }

    fn write(&self, out: &mut dyn Write, first: &mut bool) -> Result<()> {
        for [x, y, z] in &self.0 {
            let comma = if std::mem::take(first) { "" } else { "," };
            write!(out, "{comma}[{x},{y},{z}]")?;
        }
        Ok(())
    }
}

/// What stands before the objects.
fn write_head(out: &mut dyn Write) -> Result<()> {
    let [x, y, z] = TRANSLATE;
    write!(
        out,
        "{{\"type\":\"CityJSON\",\"version\":\"2.0\",\"metadata\":{{\"title\":\"a town\",\"referenceSystem\":\
         \"https://www.opengis.net/def/crs/EPSG/0/7415\"}},\"transform\":{{\"scale\":[0.001,0.001,0.001],\"translate\":\
         [{x:?},{y:?},{z:?}]}},\"CityObjects\":{{"
    )
}

pub(super) fn write(
    sample: Sample,
    town: Town,
    out: &mut dyn Write,
    truth: &mut dyn FnMut(&SampleBuilding),
) -> Result<()> {
    write_head(out)?;
    let mut before = 0;
    for number in 0..town.buildings {
        if number > 0 {
            out.write_all(b",")?;
        }
        let house = House::of(town, number);
        before += write_objects(sample, number, &house, before, out)?.0.len();
        truth(&sample.truth(number, &house));
    }
    out.write_all(b"},\"vertices\":[")?;
    // once more, for the vertices of a large town are not held
    let mut first = true;
    for number in 0..town.buildings {
        write_objects(sample, number, &House::of(town, number), 0, &mut std::io::sink())?.write(out, &mut first)?;
    }
    out.write_all(b"]}\n")
}

pub(super) fn write_sequence(
    sample: Sample,
    town: Town,
    out: &mut dyn Write,
    truth: &mut dyn FnMut(&SampleBuilding),
) -> Result<()> {
    write_head(out)?;
    out.write_all(b"},\"vertices\":[]}\n")?;
    for number in 0..town.buildings {
        let house = House::of(town, number);
        out.write_all(b"{\"type\":\"CityJSONFeature\",\"CityObjects\":{")?;
        let vertices = write_objects(sample, number, &house, 0, out)?;
        write!(out, "}},\"id\":\"{}\",\"vertices\":[", sample.name(number))?;
        vertices.write(out, &mut true)?;
        out.write_all(b"]}\n")?;
        truth(&sample.truth(number, &house));
    }
    Ok(())
}

/// The building and its parts; gives the vertices to which they refer from `before` on.
fn write_objects(sample: Sample, number: u64, house: &House, before: usize, out: &mut dyn Write) -> Result<Vertices> {
    let mut vertices = Vertices::default();
    let name = sample.name(number);
    let mut ring = |points: &[Point]| {
        let indices: Vec<String> =
            points.iter().map(|point| (before + vertices.index(sample, *point)).to_string()).collect();
        format!("[[{}]]", indices.join(","))
    };
    let children: Vec<String> = (0..house.bodies.len()).map(|part| format!("\"{name}-{part}\"")).collect();
    let footprints: Vec<String> = house.bodies.iter().map(|body| ring(&body.ground)).collect();
    write!(
        out,
        "\"{name}\":{{\"type\":\"Building\",\"attributes\":{{\"identificatie\":\"{name}\",{ATTRIBUTES}}},\"geometry\":[{{\
         \"type\":\"MultiSurface\",\"lod\":\"0\",\"boundaries\":[{}]}}],\"children\":[{}]}}",
        footprints.join(","),
        children.join(",")
    )?;
    for (part, body) in house.bodies.iter().enumerate() {
        write!(out, ",\"{name}-{part}\":{{\"type\":\"BuildingPart\",\"parents\":[\"{name}\"],\"geometry\":[")?;
        let block = block(body);
        write_solid(out, "1.2", body, &block, &mut ring)?;
        out.write_all(b",")?;
        write_solid(out, "1.3", body, &block, &mut ring)?;
        out.write_all(b",")?;
        write_solid(out, "2.2", body, body, &mut ring)?;
        out.write_all(b"]}")?;
    }
    Ok(vertices)
}

/// The body as LoD 1 has it: its ground, lifted.
fn block(body: &Body) -> Body {
    let lifted: Vec<Point> = body.ground.iter().rev().map(|[x, y, _]| [*x, *y, body.mean_height_m]).collect();
    let next = lifted.iter().cycle().skip(1);
    let edges = lifted.iter().zip(next).map(|(start, end)| crate::buildings::RoofEdge {
        kind: crate::buildings::EdgeKind::Rim,
        start: *start,
        end: *end,
    });
    let edges = edges.collect();
    Body { roof: vec![lifted], ground: body.ground.clone(), edges, mean_height_m: body.mean_height_m }
}

fn write_solid(
    out: &mut dyn Write,
    lod: &str,
    body: &Body,
    shape: &Body,
    ring: &mut dyn FnMut(&[Point]) -> String,
) -> Result<()> {
    let mut surfaces = vec![ring(&body.ground)];
    surfaces.extend(shape.roof.iter().map(|roof| ring(roof)));
    surfaces.extend(House::walls(shape).map(|wall| ring(&wall)));
    let roofs = shape.roof.len();
    let values: Vec<String> = (0..surfaces.len())
        .map(|at| {
            if at == 0 {
                "0"
            } else if at <= roofs {
                "1"
            } else {
                "2"
            }
            .to_owned()
        })
        .collect();
    write!(
        out,
        "{{\"type\":\"Solid\",\"lod\":\"{lod}\",\"boundaries\":[[{}]],\"semantics\":{{\"surfaces\":[{{\"type\":\
         \"GroundSurface\"}},{{\"type\":\"RoofSurface\",\"b3_hellingshoek\":38.2}},{{\"type\":\"WallSurface\",\
         \"on_footprint_edge\":true}}],\"values\":[[{}]]}}}}",
        surfaces.join(","),
        values.join(",")
    )
}
