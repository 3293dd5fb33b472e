//! Strips of frames: where each frame stands, and what is written beside it.

use image::{Rgb, RgbImage};
use mujoco_grasp::report::{ReportError, Row, Strip};

const WIDTH: u32 = 60;
const HEIGHT: u32 = 40;

fn row(label: &str, colors: &[[u8; 3]]) -> Row {
    let frame = |(i, c): (usize, &[u8; 3])| (4.5 + 0.25 * i as f64, RgbImage::from_pixel(WIDTH, HEIGHT, Rgb(*c)));
    Row { label: label.to_owned(), frames: colors.iter().enumerate().map(frame).collect() }
}

const FULL: [[u8; 3]; 3] = [[255, 0, 0], [0, 255, 0], [0, 0, 255]];
const GRASP: [[u8; 3]; 3] = [[255, 255, 0], [0, 255, 255], [255, 0, 255]];

/// Left, top, width and height of the box around a colour, which must fill it.
fn place(picture: &RgbImage, color: [u8; 3]) -> (u32, u32, u32, u32) {
    let found: Vec<(u32, u32)> =
        picture.enumerate_pixels().filter(|(_, _, p)| p.0 == color).map(|(x, y, _)| (x, y)).collect();
    let (left, right) = found.iter().fold((u32::MAX, 0), |(l, r), p| (l.min(p.0), r.max(p.0)));
    let (top, bottom) = found.iter().fold((u32::MAX, 0), |(t, b), p| (t.min(p.1), b.max(p.1)));
    let size = (right - left + 1, bottom - top + 1);
    assert_eq!(found.len() as u32, size.0 * size.1, "something covers {color:?}");
    (left, top, size.0, size.1)
}

#[test]
fn rows_are_modes_and_columns_are_times() {
    let strip = Strip::new("clutch", vec![row("full", &FULL), row("grasp", &GRASP)]);
    let picture = strip.image().expect("a strip");
    let places: Vec<_> = FULL.iter().chain(&GRASP).map(|c| place(&picture, *c)).collect();
    for (_, _, width, height) in &places {
        assert_eq!((*width, *height), (WIDTH, HEIGHT));
    }
    for column in 0..3 {
        let (full, grasp) = (places[column], places[3 + column]);
        assert_eq!(full.0, grasp.0, "one above the other");
        assert!(grasp.1 >= full.1 + HEIGHT + 15, "room for the time between them");
        assert_eq!(full.1, places[0].1, "one row, one height");
    }
    assert!(places[0].0 + WIDTH < places[1].0 && places[1].0 + WIDTH < places[2].0);
    let (right, bottom) = (places[5].0 + WIDTH, places[5].1 + HEIGHT);
    assert!(picture.width() > right && picture.width() < right + 40);
    assert!(picture.height() > bottom + 15 && picture.height() < bottom + 60);
}

#[test]
fn title_labels_and_times_are_written_where_they_belong() {
    let picture = Strip::new("clutch", vec![row("full", &FULL)]).image().expect("a strip");
    let frame = place(&picture, FULL[1]);
    let ink = |left: u32, top: u32, right: u32, bottom: u32| {
        let dark = |(x, y, p): (u32, u32, &Rgb<u8>)| {
            (left..right).contains(&x) && (top..bottom).contains(&y) && p.0.iter().all(|c| *c < 100)
        };
        picture.enumerate_pixels().filter(|e| dark(*e)).count()
    };
    let below = frame.1 + HEIGHT;
    assert!(ink(0, 0, picture.width(), frame.1) > 50, "the title");
    assert!(ink(0, frame.1, place(&picture, FULL[0]).0, below) > 20, "the row's label");
    assert!(ink(frame.0, below, frame.0 + WIDTH, picture.height()) > 20, "the time");
    let blank = Strip::new("", vec![row("", &FULL)]).image().expect("a strip");
    assert!(blank.width() < picture.width() && blank.height() < picture.height());
}

#[test]
fn rows_may_be_of_different_length() {
    let rows = vec![row("full", &FULL[..1]), row("none", &[]), row("grasp", &GRASP)];
    let picture = Strip::new("lost early", rows).image().expect("a strip");
    let (full, grasp) = (place(&picture, FULL[0]), place(&picture, GRASP[0]));
    assert_eq!(full.0, grasp.0);
    assert!(grasp.1 > full.1 + 2 * HEIGHT, "the empty row keeps its place");
}

#[test]
fn what_makes_no_strip_is_an_error_that_says_why() {
    for rows in [vec![], vec![row("full", &[])]] {
        let result = Strip::new("nothing", rows).image();
        assert!(matches!(result, Err(ReportError::Empty { .. })), "{result:?}");
    }
    let mut odd = row("grasp", &GRASP);
    odd.frames[2].1 = RgbImage::new(WIDTH, HEIGHT + 1);
    let message = Strip::new("odd", vec![row("full", &FULL), odd]).image().expect_err("sizes differ");
    let message = message.to_string();
    for part in ["grasp", "frame 2", "60 x 41", "60 x 40"] {
        assert!(message.contains(part), "{message}");
    }
    let mut timeless = row("full", &FULL);
    timeless.frames[1].0 = f64::NAN;
    let result = Strip::new("timeless", vec![timeless]).image();
    assert!(matches!(result, Err(ReportError::BadNumber { .. })), "{result:?}");
    let wide = row("full", &[[0, 0, 0]; 300]);
    let result = Strip::new("wide", vec![wide]).image();
    assert!(matches!(result, Err(ReportError::TooLarge { .. })), "{result:?}");
}

#[test]
fn a_strip_is_saved_as_png_and_nothing_else() {
    let folder = tempfile::tempdir().expect("a folder");
    let strip = Strip::new("clutch", vec![row("full", &FULL)]);
    let path = folder.path().join("strip.png");
    strip.save(&path).expect("saved");
    let read = image::open(&path).expect("a PNG").into_rgb8();
    assert_eq!(read, strip.image().expect("a strip"));
    let result = strip.save(folder.path().join("strip.svg"));
    assert!(matches!(result, Err(ReportError::Format { .. })), "{result:?}");
}
