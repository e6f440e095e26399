//! Images to look at: tiles, thumbnails and windows.

use std::path::PathBuf;
use std::time::{Duration, Instant};

use image::GrayImage;
use tiff::encoder::{Compression, TiffEncoder, colortype::Gray8};

use crate::support::{Answer, Service};

const WIDTH: u32 = 1300;
const HEIGHT: u32 = 700;

/// Gentle slopes, so that JPEG changes little.
fn grey(x: u32, y: u32) -> u8 {
    (x / 8 + y / 8) as u8
}

fn photograph() -> Vec<u8> {
    let mut file = std::io::Cursor::new(Vec::new());
    let picture = GrayImage::from_fn(WIDTH, HEIGHT, |x, y| image::Luma([grey(x, y)]));
    picture.write_to(&mut file, image::ImageFormat::Png).unwrap();
    file.into_inner()
}

fn tiff_of([width, height]: [u32; 2], compression: Compression) -> Vec<u8> {
    let pixels: Vec<u8> = (0..height).flat_map(|y| (0..width).map(move |x| grey(x / 4, y))).collect();
    let mut file = std::io::Cursor::new(Vec::new());
    let encoder = TiffEncoder::new(&mut file).unwrap().with_compression(compression);
    { encoder }.write_image::<Gray8>(width, height, &pixels).unwrap();
    file.into_inner()
}

async fn uploaded(service: &Service, media_type: &str, file: Vec<u8>) -> String {
    let made = service.upload(media_type, file).await;
    assert_eq!(made.status, 201, "{:?}", made.body);
    format!("/api/v1/images/{}", made.json()["id"].as_str().unwrap())
}

#[track_caller]
fn shown(answer: &Answer) -> GrayImage {
    assert_eq!(answer.status, 200, "{:?}", answer.body);
    assert_eq!(answer.headers["content-type"], "image/jpeg");
    assert_eq!(answer.headers["cache-control"], "private, max-age=31536000, immutable");
    let picture = image::load_from_memory(&answer.body).unwrap();
    assert_eq!(picture.color(), image::ColorType::L8);
    picture.to_luma8()
}

/// Whether each pixel is the mean of the square of the file that it stands for, but for what JPEG makes of it.
#[track_caller]
fn assert_means(
    picture: &GrayImage,
    first: [u32; 2],
    side: u32,
    [width, height]: [u32; 2],
    grey: impl Fn(u32, u32) -> u8,
) {
    for (x, y, pixel) in picture.enumerate_pixels() {
        let (left, top) = ((first[0] + x) * side, (first[1] + y) * side);
        let square = (top..height.min(top + side)).flat_map(|y| (left..width.min(left + side)).map(move |x| (x, y)));
        let values: Vec<f64> = square.map(|(x, y)| f64::from(grey(x, y))).collect();
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        assert!((f64::from(pixel[0]) - mean).abs() <= 5.0, "({x}, {y}): {} instead of {mean}", pixel[0]);
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn tiles_show_each_level_of_an_image() {
    let service = Service::new().await;
    let image = uploaded(&service, "image/png", photograph()).await;
    let tile = async |path: &str| service.get(&format!("{image}/tiles/{path}")).await;
    for (path, size, level) in [
        ("0/0/0", (512, 512), 0),
        ("0/2/1", (1300 - 1024, 700 - 512), 0),
        ("1/1/0", (650 - 512, 350), 1),
        ("2/0/0", (325, 175), 2),
    ] {
        let picture = shown(&tile(path).await);
        assert_eq!(picture.dimensions(), size, "{path}");
        let place: Vec<u32> = path.split('/').map(|number| number.parse().unwrap()).collect();
        assert_means(&picture, [512 * place[1], 512 * place[2]], 1 << level, [WIDTH, HEIGHT], grey);
    }
    for path in ["0/3/0", "0/0/2", "2/1/0", "3/0/0", "0/-1/0", "0/0/x", "40/0/0", "4294967295/4294967295/4294967295"] {
        tile(path).await.problem(404);
    }
    service.get("/api/v1/images/01a20225-f91a-7133-9892-18bd6449110e/tiles/0/0/0").await.problem(404);
}

#[tokio::test(flavor = "multi_thread")]
async fn windows_show_what_of_them_lies_in_the_image() {
    let service = Service::new().await;
    let image = uploaded(&service, "image/png", photograph()).await;
    let window = async |query: &str| service.get(&format!("{image}/window?{query}")).await;
    let picture = shown(&window("x=1000&y=500&width=120&height=80").await);
    assert_eq!(picture.dimensions(), (120, 80));
    assert_means(&picture, [1000, 500], 1, [WIDTH, HEIGHT], grey);
    assert_eq!(shown(&window("x=1290&y=-20&width=2048&height=30").await).dimensions(), (10, 10));
    assert_eq!(shown(&window("x=-5&y=699&width=6&height=1").await).dimensions(), (1, 1));
    for (query, pointer) in [
        ("x=1300&y=0&width=1&height=1", "?x"),
        ("x=-10&y=0&width=10&height=1", "?x"),
        ("x=0&y=9223372036854775807&width=1&height=2048", "?y"),
        ("x=0&y=-9223372036854775808&width=1&height=1", "?y"),
        ("x=0&y=0&width=0&height=1", "?width"),
        ("x=0&y=0&width=1&height=2049", "?height"),
        ("x=0.5&y=0&width=1&height=1", "?x"),
    ] {
        assert_eq!(window(query).await.problem(422), [pointer], "{query}");
    }
    window("x=0&y=0&width=1").await.problem(422);
    window("x=0&y=0&width=1&height=1&format=png").await.problem(422);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_thumbnail_is_small_and_made_once() {
    let service = Service::new().await;
    let image = uploaded(&service, "image/png", photograph()).await;
    let thumbnail = service.get(&format!("{image}/thumbnail")).await;
    // a sixth of 1300 x 700
    let picture = shown(&thumbnail);
    assert_eq!(picture.dimensions(), (217, 117));
    assert_means(&picture, [0, 0], 6, [WIDTH, HEIGHT], grey);
    let [kept] = &service.files("overviews")[..] else { panic!("{:?}", service.files("overviews")) };
    assert!(kept.ends_with(".thumbnail.jpg"));
    assert_eq!(std::fs::read(service.state.store.folder().join("overviews").join(kept)).unwrap(), thumbnail.body);
    assert_eq!(service.get(&format!("{image}/thumbnail")).await.body, thumbnail.body);
    assert_eq!(service.delete(&image).await.status, 204);
    service.get(&format!("{image}/thumbnail")).await.problem(404);
    assert_eq!(service.files("overviews"), Vec::<String>::new());
}

/// The file of the overview, which comes a little later than the first tile.
async fn overview(service: &Service) -> PathBuf {
    for _ in 0..1000 {
        if let Some(name) = service.files("overviews").iter().find(|name| name.ends_with(".overview.jpg")) {
            return service.state.store.folder().join("overviews").join(name);
        }
        tokio::time::sleep(Duration::from_millis(10)).await;
    }
    panic!("there is none");
}

#[tokio::test(flavor = "multi_thread")]
async fn higher_levels_of_a_large_image_come_from_its_overview() {
    const SIZE_PX: [u32; 2] = [5001, 300];
    let slope = |x: u32, y: u32| grey(x / 4, y);
    let service = Service::new().await;
    let image = uploaded(&service, "image/tiff", tiff_of(SIZE_PX, Compression::Uncompressed)).await;
    let tile = async |path: &str| service.get(&format!("{image}/tiles/{path}")).await;
    assert_eq!(shown(&tile("0/9/0").await).dimensions(), (5001 - 9 * 512, 300));
    assert_eq!(service.files("overviews"), Vec::<String>::new(), "the pixels of the file need none");
    for (path, size, level) in [("1/4/0", (2501 - 2048, 150), 1), ("4/0/0", (313, 19), 4)] {
        let picture = shown(&tile(path).await);
        assert_eq!(picture.dimensions(), size, "{path}");
        let column = path.split('/').nth(1).unwrap().parse::<u32>().unwrap();
        assert_means(&picture, [512 * column, 0], 1 << level, SIZE_PX, slope);
    }
    assert_eq!(image::open(overview(&service).await).unwrap().to_luma8().dimensions(), (2501, 150));
    let highest = tile("4/0/0").await.body;
    tile("5/0/0").await.problem(404);
    // a service that begins anew takes the one that is there, and makes one that is damaged again
    let store = service.reopened().await;
    let state = gable::http::AppState::new(store, (*service.state.configuration).clone());
    for damage in [false, true] {
        if damage {
            std::fs::write(overview(&service).await, b"no picture").unwrap();
        }
        let id = image.rsplit('/').next().unwrap().parse().unwrap();
        let row = state.store.image(id).await.unwrap().unwrap();
        state.pictures.forget(&row.sha256);
        let shown = state.pictures.tile(&row, [4, 0, 0]).await.unwrap().unwrap();
        let shown = image::load_from_memory(&shown).unwrap().to_luma8();
        assert_means(&shown, [0, 0], 16, SIZE_PX, slope);
        let began = Instant::now();
        while image::open(overview(&service).await).is_err() {
            assert!(began.elapsed() < Duration::from_secs(20), "it was not made again");
            tokio::time::sleep(Duration::from_millis(10)).await;
        }
        assert_eq!(image::open(overview(&service).await).unwrap().to_luma8().dimensions(), (2501, 150));
    }
    assert_eq!(tile("4/0/0").await.body, highest);
    assert_eq!(service.delete(&image).await.status, 204);
    assert_eq!(service.files("overviews"), Vec::<String>::new());
}

#[tokio::test(flavor = "multi_thread")]
async fn what_is_left_of_small_pictures_is_swept() {
    let service = Service::new().await;
    let image = uploaded(&service, "image/png", photograph()).await;
    service.get(&format!("{image}/thumbnail")).await;
    let folder = service.state.store.folder().join("overviews");
    let kept = service.files("overviews");
    for name in
        ["x.part".to_owned(), format!("{}.overview.jpg", "ab".repeat(32)), format!("{}.thumbnail.jpg", "cd".repeat(32))]
    {
        std::fs::write(folder.join(name), b"x").unwrap();
    }
    let old = std::time::SystemTime::now() - Duration::from_secs(7200);
    for name in service.files("overviews").into_iter().filter(|name| !name.starts_with("cd")) {
        std::fs::File::options().append(true).open(folder.join(name)).unwrap().set_modified(old).unwrap();
    }
    assert_eq!(service.state.store.sweep_uploads().await.unwrap(), 2);
    let mut left = service.files("overviews");
    left.retain(|name| !name.starts_with("cd"));
    assert_eq!(left, kept);
}

#[tokio::test(flavor = "multi_thread")]
async fn damaged_and_missing_files_are_told() {
    let service = Service::new().await;
    let cut = photograph()[..photograph().len() / 2].to_vec();
    let mut garbled = tiff_of([5000, 400], Compression::Deflate(Default::default()));
    let middle = garbled.len() / 2;
    garbled[middle..middle + 40].fill(0xff);
    for (media_type, file) in [("image/png", cut), ("image/tiff", garbled)] {
        let image = uploaded(&service, media_type, file).await;
        for rest in ["tiles/3/0/0", "thumbnail"] {
            let path =
                format!("{image}/{}", if media_type == "image/png" { rest.replace('3', "0") } else { rest.into() });
            service.get(&path).await.problem(422);
            service.get(&path).await.problem(422);
        }
    }
    assert_eq!(service.files("overviews"), Vec::<String>::new());
    let image = uploaded(&service, "image/png", photograph()).await;
    let sha256 = service.get(&image).await.json()["sha256"].as_str().unwrap().to_owned();
    std::fs::remove_file(service.state.store.folder().join("images").join(sha256)).unwrap();
    service.get(&format!("{image}/tiles/0/0/0")).await.problem(410);
}

#[tokio::test(flavor = "multi_thread")]
async fn many_who_look_at_once_all_see_something() {
    let service = Service::with(|configuration| configuration.viewer_cache_bytes = 1).await;
    let mut images = vec![uploaded(&service, "image/png", photograph()).await];
    for height in [300, 301] {
        images.push(uploaded(&service, "image/tiff", tiff_of([5000, height], Compression::Lzw)).await);
    }
    let paths = ["tiles/0/0/0", "tiles/1/1/0", "thumbnail", "window?x=0&y=0&width=9&height=9"];
    let all = (0..60).map(|n| format!("{}/{}", images[n % 3], paths[n % 4]));
    let answers = futures_util::future::join_all(all.map(async |path| service.get(&path).await.status)).await;
    assert!(answers.iter().all(|status| *status == 200), "{answers:?}");
}
