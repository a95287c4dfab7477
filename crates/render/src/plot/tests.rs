//! Tests of complete figures, which are parsed: well-formed markup, correct positions, reproducible bytes, for
//! arbitrary data.

use base64::prelude::{BASE64_STANDARD, Engine};
use proptest::prelude::*;
use radarllm_base::{BoardReport, BoardTrack, PointFrame, RadarPoint};

use super::*;

/// An element of a figure with its attributes and its own text.
#[derive(Debug)]
struct Element {
    tag: String,
    attributes: Vec<(String, String)>,
    text: String,
}

impl Element {
    fn attribute(&self, name: &str) -> &str {
        let found = self.attributes.iter().find(|(n, _)| n == name);
        found.map_or("", |(_, value)| value)
    }

    fn number(&self, name: &str) -> f64 {
        self.attribute(name).parse().unwrap()
    }
}

/// Parses a figure. Checks that tags are closed in order, that attributes are quoted and unique, that text has only
/// known entities, and that all numbers are valid.
fn elements(svg: &str) -> Vec<Element> {
    let mut all: Vec<Element> = Vec::new();
    let mut open: Vec<usize> = Vec::new();
    let mut rest = svg;
    while let Some(at) = rest.find('<') {
        let text = &rest[..at];
        check_text(text);
        match open.last() {
            Some(parent) => all[*parent].text += text,
            None => assert!(text.trim().is_empty(), "text outside: {text}"),
        }
        let end = at + rest[at..].find('>').expect("a tag ends");
        let tag = &rest[at + 1..end];
        rest = &rest[end + 1..];
        if let Some(name) = tag.strip_prefix('/') {
            let closed = open.pop().expect("a tag was open");
            assert_eq!(all[closed].tag, name);
            continue;
        }
        let (tag, is_closed) = match tag.strip_suffix('/') {
            Some(tag) => (tag, true),
            None => (tag, false),
        };
        let (name, mut list) = tag.split_once(' ').unwrap_or((tag, ""));
        let mut attributes: Vec<(String, String)> = Vec::new();
        while !list.trim().is_empty() {
            let (key, after) = list.trim_start().split_once("=\"").expect("key=\"");
            let (value, after) = after.split_once('"').expect("a closing quote");
            check_text(value);
            assert!(attributes.iter().all(|(k, _)| k != key), "{key} twice");
            for word in ["NaN", "nan", "inf", "0000000"] {
                assert!(key == "href" || !value.contains(word), "{key}={value}");
            }
            attributes.push((key.into(), value.into()));
            list = after;
        }
        all.push(Element {
            tag: name.into(),
            attributes,
            text: String::new(),
        });
        if !is_closed {
            open.push(all.len() - 1);
        }
    }
    assert!(open.is_empty() && rest.trim().is_empty());
    assert_eq!(all[0].tag, "svg");
    all
}

fn check_text(text: &str) {
    assert!(!text.contains(['<', '>']));
    for after in text.split('&').skip(1) {
        let entity = after.split(';').next().unwrap();
        assert!(
            ["amp", "lt", "gt", "quot", "#39"].contains(&entity),
            "{entity}"
        );
    }
    let is_allowed = |c: char| c >= ' ' || c == '\n';
    assert!(text.chars().all(is_allowed));
}

fn texts(svg: &str) -> Vec<String> {
    let all = elements(svg);
    let texts = all.iter().filter(|e| e.tag == "text");
    texts.map(|e| e.text.clone()).collect()
}

/// Keyword and text of a chunk.
type Chunk = (String, String);

/// Decodes a PNG file into width, height, RGB values and text chunks.
fn decoded(png: &[u8]) -> (usize, usize, Vec<[u8; 3]>, Vec<Chunk>) {
    let (width, height, pixels) = crate::png_file::tests::decoded(png);
    let mut chunks = Vec::new();
    let mut rest = &png[8..];
    while let Some((head, data)) = rest.split_at_checked(8) {
        let length = u32::from_be_bytes(head[..4].try_into().unwrap()) as usize;
        if &head[4..] == b"tEXt" {
            let latin_1: String = data[..length].iter().copied().map(char::from).collect();
            let (keyword, text) = latin_1.split_once('\0').unwrap();
            chunks.push((keyword.into(), text.into()));
        }
        rest = &data[length + 4..];
    }
    (width, height, pixels, chunks)
}

/// The first image embedded in a figure.
fn embedded(svg: &str) -> Vec<u8> {
    let all = elements(svg);
    let image = all.iter().find(|e| e.tag == "image").unwrap();
    let data = image.attribute("href");
    let data = data.strip_prefix("data:image/png;base64,").unwrap();
    BASE64_STANDARD.decode(data).unwrap()
}

fn map(n_rows: usize, n_cols: usize, values: Vec<f32>) -> Heatmap {
    Heatmap {
        title: "A map".into(),
        x: Axis::new("Velocity", "m/s").with_cells(-1.0, 1.0, n_cols),
        y: Axis::new("Range", "m").with_cells(2.0, 0.5, n_rows),
        values: Grid::new(n_rows, n_cols, values).unwrap(),
        colour_bar: Axis::new("Power", "dB"),
    }
}

#[test]
fn maps_put_row_zero_at_the_bottom_and_column_zero_at_the_left() {
    let mut values = vec![0.0; 12];
    values[2] = 1.0; // row 0, column 2 of 3: bottom right
    values[9] = f32::NAN; // row 3, column 0: top left
    let map = map(4, 3, values);
    let png = map.to_png().unwrap();
    assert_eq!(embedded(&map.to_svg()), png);
    let (width, height, pixels, chunks) = decoded(&png);
    assert_eq!((width, height), (3, 4));
    let [dark, yellow, grey] = [[68, 1, 84], [253, 231, 37], [128; 3]];
    let mut expected = vec![dark; 12];
    expected[11] = yellow;
    expected[0] = grey;
    assert_eq!(pixels, expected);
    // The extents are the outer edges of the cells.
    let expected = [
        ("Title", "A map"),
        ("x-axis", "Velocity (m/s) from -1.500000 to 1.500000"),
        ("y-axis", "Range (m) from 1.750000 to 3.750000"),
        ("colour", "Power (dB) from 0.000000 to 1.000000"),
    ];
    assert_eq!(chunks, expected.map(|(k, t)| (k.into(), t.into())));
}

#[test]
fn ticks_of_a_figure_stand_at_the_values_they_name() {
    let plot = LinePlot {
        x: Axis::new("Distance", "m").with_limits(0.0, 40.0),
        y: Axis::new("Power", "dB").with_limits(-2.0, 2.0),
        series: vec![Series::new("", [[10.0, -1.0], [30.0, 1.0]])],
        ..LinePlot::default()
    };
    let svg = plot.to_svg();
    let all = elements(&svg);
    let tick = |name: &str, attribute: &str| {
        let found = all.iter().find(|e| e.tag == "text" && e.text == name);
        found
            .unwrap_or_else(|| panic!("no {name}"))
            .number(attribute)
    };
    let curve = all.iter().find(|e| e.attribute("stroke") == "#0072b2");
    let places = curve.unwrap().attribute("d").replace(['M', 'L'], " ");
    let places: Vec<f64> = places
        .split_whitespace()
        .map(|v| v.parse().unwrap())
        .collect();
    // Text is centred vertically: its baseline is 0.35 of its size below the tick.
    let baseline = 0.35 * 7.0;
    assert!((places[0] - tick("10", "x")).abs() < 0.011);
    assert!((places[2] - tick("30", "x")).abs() < 0.011);
    assert!((places[1] + baseline - tick("\u{2212}1", "y")).abs() < 0.011);
    assert!((places[3] + baseline - tick("1", "y")).abs() < 0.011);
    assert!(places[2] > places[0] && places[3] < places[1]);
    let names = texts(&svg);
    assert!(names.contains(&"Distance (m)".into()) && names.contains(&"Power (dB)".into()));
}

fn point(x_m: f32, velocity_mps: f32) -> RadarPoint {
    RadarPoint {
        x_m,
        y_m: 3.0,
        velocity_mps,
        ..RadarPoint::default()
    }
}

/// Centres of the discs of one colour.
fn discs(svg: &str, colour: &str) -> Vec<[f64; 2]> {
    let mut inside = "";
    let mut found = Vec::new();
    let all = elements(svg);
    for element in &all {
        match element.tag.as_str() {
            "g" => inside = element.attribute("fill"),
            "circle" if inside == colour => {
                found.push([element.number("cx"), element.number("cy")]);
            }
            _ => {}
        }
    }
    found
}

const APPROACHING: &str = "#00429d";
const RECEDING: &str = "#b01428";

#[test]
fn points_to_the_right_are_drawn_to_the_right() {
    let svg = point_cloud(&[point(-1.0, -1.0), point(1.0, 1.0)], "p").to_svg();
    // The first panel shows the view from above. In the side view, both points are at the same position.
    let (left, right) = (discs(&svg, APPROACHING), discs(&svg, RECEDING));
    assert_eq!((left.len(), right.len()), (2, 2));
    assert!(left[0][0] + 50.0 < right[0][0] && left[0][1] == right[0][1]);
    assert_eq!(left[1], right[1]);
}

#[test]
fn later_points_are_drawn_to_the_right_and_farther_ones_higher() {
    let frame = |time_s: f64, range_m: f32, velocity_mps: f32| PointFrame {
        time_s,
        points: vec![RadarPoint {
            range_m,
            velocity_mps,
            ..RadarPoint::default()
        }],
        ..PointFrame::default()
    };
    let frames = [frame(0.0, 2.0, -1.0), frame(1.0, 4.0, 1.0)];
    let svg = points_over_time(&frames, "t").to_svg();
    let (early, late) = (discs(&svg, APPROACHING)[0], discs(&svg, RECEDING)[0]);
    assert!(late[0] > early[0] + 50.0 && late[1] + 50.0 < early[1]);
}

#[test]
fn a_timeline_parts_numbers_and_lists_what_is_said() {
    let frames: Vec<PointFrame> = (0..=10)
        .map(|i| PointFrame {
            time_s: f64::from(i),
            points: vec![point(0.1, 1.0)],
            ..PointFrame::default()
        })
        .collect();
    let said = |from, to, text: &str| Span {
        from,
        to,
        text: text.into(),
    };
    let spans = vec![
        said(0.0, 5.0, "a person walks"),
        said(5.0, 10.0, "a person <falls>"),
        said(10.0, 10.01, "a person lies"),
    ];
    let svg = timeline(&frames, spans, "t").to_svg();
    let all = elements(&svg);
    let texts: Vec<String> = all.iter().map(|e| e.text.clone()).collect();
    // The third is too short for its number, and is listed all the same.
    assert!(texts.contains(&"1".into()) && texts.contains(&"2".into()));
    for line in [
        "1 a person walks",
        "2 a person &lt;falls&gt;",
        "3 a person lies",
    ] {
        assert!(svg.contains(&format!(">{line}</text>")), "{line}");
    }
    // Two borders in each of the three panels.
    let borders = all
        .iter()
        .filter(|e| !e.attribute("stroke-dasharray").is_empty());
    assert_eq!(borders.count(), 6);
}

#[test]
fn a_timeline_draws_tracks_of_the_board_as_lines_and_no_leakage() {
    let near = || RadarPoint {
        y_m: 0.2,
        ..point(0.1, 1.0)
    };
    let frame = |i: u32| {
        let track = |id: u32, height_m: Option<f32>| BoardTrack {
            id,
            place_m: [0.5, 2.0],
            height_m,
            velocity_mps: [0.0; 3],
        };
        // Track 1 is missed for 2 s; track 2 has no height.
        let mut tracks = vec![track(2, None)];
        if !(10..30).contains(&i) {
            tracks.push(track(1, Some(0.3)));
        }
        PointFrame {
            time_s: f64::from(i) / 10.0,
            points: vec![near(), point(0.2, 3.0)],
            board: Some(BoardReport {
                tracks,
                is_present: None,
            }),
            ..PointFrame::default()
        }
    };
    let frames: Vec<PointFrame> = (0..50).map(frame).collect();
    let plot = timeline(&frames, Vec::new(), "t");
    assert!(plot.panels.iter().all(|p| p.points.len() == 50));
    let lengths =
        |panel: usize| -> Vec<usize> { plot.panels[panel].lines.iter().map(Vec::len).collect() };
    assert_eq!((lengths(0), lengths(2)), (vec![50, 10, 20], vec![10, 20]));
    let drawn = elements(&plot.to_svg());
    let lines = drawn
        .iter()
        .filter(|e| e.attribute("stroke-width") == "0.8");
    assert_eq!(lines.count(), 8);
    // Where there is nothing but leakage, it is drawn.
    let near: Vec<PointFrame> = frames.iter().map(|f| f.with_points(vec![near()])).collect();
    let leakage = timeline(&near, Vec::new(), "t");
    assert_eq!(leakage.panels[0].points.len(), 50);
    assert!(leakage.to_svg().contains("Leakage of the radar alone"));
    assert!(!plot.to_svg().contains("Leakage"));
    // What has one place and no tracks has an axis that shows centimetres, not fractions of a millimetre.
    let alone: Vec<PointFrame> = near
        .into_iter()
        .map(|frame| PointFrame {
            board: None,
            ..frame
        })
        .collect();
    for plot in [
        timeline(&alone, Vec::new(), "t"),
        points_over_time(&alone, "t"),
    ] {
        let [first_m, last_m] = plot.panels[0].y.limits.unwrap();
        assert!((last_m - first_m - 0.5).abs() < 1e-9);
        assert!((first_m..last_m).contains(&plot.panels[0].points[0][1]));
    }
    // The tracks are drawn, too.
    assert_eq!(leakage.panels[0].y.limits, None);
}

#[test]
fn a_unit_of_a_map_is_as_long_on_both_axes() {
    let plot = LinePlot {
        x: Axis::new("x", "m"),
        y: Axis::new("y", "m"),
        series: vec![Series::new("", [[0.0, 0.0], [1.0, 0.0], [1.0, 2.0]])],
        aspect: Aspect::Equal,
        ..LinePlot::default()
    };
    let svg = plot.to_svg();
    let all = elements(&svg);
    let curve = all.iter().find(|e| e.attribute("stroke") == "#0072b2");
    let places = curve.unwrap().attribute("d").replace(['M', 'L'], " ");
    let places: Vec<f64> = places
        .split_whitespace()
        .map(|v| v.parse().unwrap())
        .collect();
    let (level, upright) = (places[2] - places[0], places[3] - places[5]);
    assert!((2.0 * level - upright).abs() < 0.05, "{level} {upright}");
}

#[test]
fn many_points_become_a_picture() {
    let points: Vec<RadarPoint> = (0..10_001)
        .map(|i| point((i as f32 * 0.37).sin(), (i as f32 * 0.11).cos()))
        .collect();
    let plot = point_cloud(&points, "many");
    let svg = plot.to_svg();
    assert_eq!(discs(&svg, APPROACHING).len(), 0);
    assert!(svg.len() < 200_000, "{}", svg.len());
    let (width, _, pixels, _) = decoded(&embedded(&svg));
    assert!(width > 600 && pixels.iter().any(|p| *p != [255; 3]));
    assert!(discs(&point_cloud(&points[..10_000], "").to_svg(), APPROACHING).len() > 10);
    // The PNG image contains both panels, and its chunks state their extents.
    let (png_width, _, _, chunks) = decoded(&plot.to_png().unwrap());
    assert_eq!(png_width, width);
    let keywords: Vec<&str> = chunks.iter().map(|(k, _)| k.as_str()).collect();
    let expected = [
        "Title",
        "x-axis of panel 1",
        "y-axis of panel 1",
        "x-axis of panel 2",
        "y-axis of panel 2",
        "colour",
    ];
    assert_eq!(keywords, expected);
    assert!(ScatterPlot::default().to_png().is_err());
}

#[test]
fn large_maps_show_the_maximum_of_neighbouring_cells() {
    let mut values = vec![0.0; 9000];
    values[8999] = 7.0;
    values[0] = f32::NAN;
    let (width, height, pixels, _) = decoded(&map(1, 9000, values).to_png().unwrap());
    assert_eq!((width, height), (3000, 1));
    assert_eq!(pixels[2999], [253, 231, 37]);
    assert_eq!(pixels[0], [68, 1, 84]);
}

#[test]
fn names_stay_text() {
    let hostile = "</text><script>\"'&\u{1}\u{0} \u{1F600}";
    let axis = || Axis::new(hostile, hostile);
    let plots = [
        LinePlot {
            title: hostile.into(),
            x: axis(),
            y: axis(),
            series: vec![Series::new(hostile, [[0.0, 1.0]])],
            ..LinePlot::default()
        }
        .to_svg(),
        Histogram {
            title: hostile.into(),
            x: axis(),
            y: axis(),
            edges: vec![0.0, 1.0],
            series: vec![(hostile.into(), vec![1.0])],
        }
        .to_svg(),
        Heatmap {
            title: hostile.into(),
            x: axis(),
            y: axis(),
            colour_bar: axis(),
            ..Heatmap::default()
        }
        .to_svg(),
        point_cloud(&[], hostile).to_svg(),
    ];
    for svg in plots {
        assert!(elements(&svg).iter().all(|e| e.tag != "script"));
        assert!(svg.contains("&lt;script&gt;") && svg.contains('\u{1F600}'));
    }
    // Text chunks are Latin-1.
    let map = Heatmap {
        title: "Fl\u{e4}che \u{2212}1 \u{1F600}".into(),
        ..map(1, 1, vec![0.0])
    };
    let (.., chunks) = decoded(&map.to_png().unwrap());
    assert_eq!(chunks[0].1, "Fl\u{e4}che -1 ?");
}

#[test]
fn figures_without_data_say_so() {
    let empty = [
        map(0, 0, vec![]).to_svg(),
        Heatmap::default().to_svg(),
        LinePlot::default().to_svg(),
        Histogram::default().to_svg(),
        points_over_time(&[], "").to_svg(),
    ];
    for svg in empty {
        assert!(texts(&svg).contains(&"no data".into()), "{svg}");
    }
    let nowhere = RadarPoint {
        x_m: f32::NAN,
        y_m: f32::INFINITY,
        ..RadarPoint::default()
    };
    let svg = point_cloud(&[nowhere], "").to_svg();
    assert_eq!(texts(&svg).iter().filter(|t| *t == "no data").count(), 2);
    // A single point and equal values are valid data.
    let one = [
        map(1, 1, vec![3.0]).to_svg(),
        map(2, 2, vec![-7.0; 4]).to_svg(),
        point_cloud(&[point(0.0, 0.0)], "").to_svg(),
        LinePlot {
            series: vec![Series::new("", [[4.0, 4.0]])],
            ..LinePlot::default()
        }
        .to_svg(),
    ];
    for svg in one {
        assert!(!texts(&svg).contains(&"no data".into()), "{svg}");
        assert!(texts(&svg).len() >= 4, "axes have numbers");
    }
    assert!(map(0, 0, vec![]).to_png().is_err());
    assert!(Grid::new(2, 2, vec![0.0; 3]).is_err());
    assert!(Grid::new(usize::MAX, 2, vec![0.0]).is_err());
    // A figure without panels still has its title.
    elements(&ScatterPlot::default().to_svg());
}

#[test]
fn series_are_told_apart_and_named() {
    let series =
        (0..14).map(|i| Series::new(format!("person {i}"), [[0.0, 0.0], [1.0, f64::from(i)]]));
    let svg = LinePlot {
        series: series.chain([Series::new("", [[0.0, 0.0]])]).collect(),
        ..LinePlot::default()
    }
    .to_svg();
    let all = elements(&svg);
    let looks = |e: &&Element| e.tag == "path" && e.attribute("stroke-width") == "1.1";
    let looks: std::collections::BTreeSet<_> = all
        .iter()
        .filter(looks)
        .map(|e| (e.attribute("stroke"), e.attribute("stroke-dasharray")))
        .collect();
    assert_eq!(looks.len(), 15);
    assert_eq!(
        texts(&svg)
            .iter()
            .filter(|t| t.starts_with("person"))
            .count(),
        14
    );
    for element in all.iter().filter(|e| e.tag == "text") {
        assert!((0.0..=241.0).contains(&element.number("x")));
    }
}

/// All kinds of numbers that a computation may produce.
fn any_number() -> impl Strategy<Value = f64> {
    prop_oneof![
        4 => -100.0_f64..100.0,
        1 => any::<f64>(),
        1 => prop::sample::select(vec![0.0, f64::NAN, f64::INFINITY, f64::MIN, f64::MAX, 1e-320, 1e9, 1e9 + 1.0]),
    ]
}

proptest! {
    #[test]
    fn figures_are_well_formed_whatever_the_data(
        numbers in prop::collection::vec(any_number(), 0..40),
        limits in prop::option::of([any_number(), any_number()]),
        kind in 0..3_usize,
        is_equal: bool,
    ) {
        let kind = [AxisScale::Linear, AxisScale::Log10, AxisScale::SignedLog][kind];
        let axis = |limits| Axis { limits, ..Axis::new("Value", "m").with_scale(kind) };
        let aspect = if is_equal && kind == AxisScale::Linear { Aspect::Equal } else { Aspect::Fill };
        let points = numbers.windows(4).map(|w| CurvePoint { x: w[0], y: w[1], interval: Some([w[2], w[3]]) });
        let lines = LinePlot {
            x: axis(limits),
            y: axis(None),
            series: vec![Series::new("a", points), Series::new("b", numbers.iter().map(|n| [*n, -n]))],
            markers: Markers::EveryPoint,
            aspect,
            ..LinePlot::default()
        };
        let histogram = Histogram {
            x: axis(None),
            y: axis(limits),
            edges: numbers.clone(),
            series: vec![("a".into(), numbers.clone())],
            ..Histogram::default()
        };
        let scatter = ScatterPlot {
            panels: vec![ScatterPanel {
                x: axis(None),
                y: axis(limits),
                points: numbers.windows(3).map(|w| [w[0], w[1], w[2]]).collect(),
                aspect,
                ..ScatterPanel::default()
            }],
            colour_bar: axis(limits),
            ..ScatterPlot::default()
        };
        let values: Vec<f32> = numbers.iter().map(|n| *n as f32).collect();
        let heatmap = Heatmap {
            x: axis(limits),
            y: axis(None),
            values: Grid::new(1, values.len(), values).unwrap(),
            colour_bar: axis(limits),
            ..Heatmap::default()
        };
        for draw in [
            &(|| lines.to_svg()) as &dyn Fn() -> String,
            &|| histogram.to_svg(),
            &|| scatter.to_svg(),
            &|| heatmap.to_svg(),
        ] {
            let svg = draw();
            elements(&svg);
            prop_assert_eq!(&svg, &draw());
            prop_assert!(svg.len() < 100_000, "{}", svg.len());
        }
        prop_assert!(decoded(&scatter.to_png().unwrap()).0 > 100);
    }
}
